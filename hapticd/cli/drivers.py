"""``hapticd drivers``: what is installed."""

from __future__ import annotations

from hapticd.cli import output
from hapticd.cli.command import command


@command("hapticd drivers", "hapticd drivers --json")
def drivers() -> None:
    """List the installed drivers, with their declared sample-to-current latency.

    Drivers are entry points of the group hapticd.drivers; one that cannot be loaded is listed with the reason.
    """
    from drivers import discover

    found = discover()
    lines = []
    for driver in found:
        held = ", has an enable input" if driver.driver is not None and driver.driver.enable_input else ""
        lines.append(f"{driver.name:12} {driver.summary or '-'}")
        lines.append(f"{'':12} {driver.origin}, latency {1e6 * driver.latency_s:g} us{held}")
        if driver.error:
            lines.append(f"{'':12} cannot be loaded: {driver.error}")
    output.emit({"drivers": [vars(driver) for driver in found]}, "\n".join(lines) or "no drivers are installed")
