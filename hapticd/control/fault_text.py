"""The text of a latched fault, for the command line and the daemon's banner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def fault_lines(fault: Mapping[str, Any]) -> list[str]:
    """Cause, time and configuration of a fault, the remedy, and the help page, one line each.

    Args:
        fault: as `hapticd.control.schemas.Fault`.
    """
    since = "latched from before" if fault.get("from_before") else "latched"
    if when := fault.get("time"):
        since += f" at {when.replace('T', ' ').replace('+00:00', ' UTC')}"
    if config := fault.get("config"):
        since += f", with {config} ({fault.get('config_digest')})"
    lines = [f"{fault['code']}: {fault['cause']}"]
    if when or fault.get("from_before"):
        lines.append(since)
    if lost := fault.get("not_latched"):
        lines.append(f"ATTENTION: {lost}")
    if remedy := fault.get("remedy"):
        lines.append(f"to do: {remedy}")
    return [*lines, f"more: {fault['help']}"]
