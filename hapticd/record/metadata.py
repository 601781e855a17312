"""What makes a run file describe itself: config, model, versions of the software and facts about the host.

Metadata is a plain dictionary. In an Arrow or Parquet schema each top-level key ``k`` becomes ``hapticd.k`` with a JSON
value, so that any Arrow reader shows it without knowing hapticd.
"""

from __future__ import annotations

import functools
import importlib.metadata
import json
import math
import os
import platform
import socket
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from hapticd.record.stream import FORMAT_VERSION, METADATA_CHECK, from_json

_PREFIX = b"hapticd."
_PACKAGES = ("hapticd", "numpy", "numba", "llvmlite", "scipy", "pyarrow", "pydantic")
_MAPPINGS = ("config", "model", "versions", "host", "imported", "units")
_MODEL_SECTIONS = ("plant", "amplifier", "encoder", "hand")


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python, hapticd and the libraries that shape the numbers (nothing is imported for it)."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _first_line(path: str, key: str = "") -> str | None:
    """First line of a file that starts with ``key``, without the key; None where there is none."""
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    return next((line[len(key) :].strip(" \t:=\"'") for line in lines if line.startswith(key)), None)


@functools.cache
def host_facts() -> dict[str, Any]:
    """Facts about this machine that matter to timing; a fact that cannot be read is None. Never raises."""
    governor = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
    return {
        "hostname": socket.gethostname(),
        "system": platform.system(),
        "os": _first_line("/etc/os-release", "PRETTY_NAME"),
        "kernel": platform.release(),
        "kernel_build": platform.version(),
        "kernel_realtime": _first_line("/sys/kernel/realtime") == "1",
        "machine": platform.machine(),
        "cpu": _first_line("/proc/cpuinfo", "model name"),
        "cpu_count": os.cpu_count(),
        "cpu_governor": _first_line(governor),
        "clocksource": _first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        "memory": _first_line("/proc/meminfo", "MemTotal"),
    }


def utc_now() -> datetime:
    """Now, with its time zone."""
    return datetime.now(UTC)


def run_metadata(config: Mapping[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """Metadata of a run: everything needed to repeat it; what is left out, or None, is filled in.

    Args:
        config: the resolved config in JSON form (``Config.model_dump(mode="json")``).
        more: further keys, e.g. ``config_digest``. ``model``: of the device; without it, the sections of the config that
            describe one. ``linear``: metres and newtons; without it, ``encoder.counts_per_metre`` tells.
    """
    config = config or {}
    known = {"config": config} | {key: value for key, value in more.items() if value is not None}
    known.setdefault("model", {name: config[name] for name in _MODEL_SECTIONS if name in config})
    encoder = config.get("encoder")
    known.setdefault("linear", isinstance(encoder, Mapping) and bool(encoder.get("counts_per_metre")))
    known.setdefault("versions", versions())
    known.setdefault("host", host_facts())
    known.setdefault("created_utc", utc_now().isoformat(timespec="milliseconds"))
    known["format_version"] = FORMAT_VERSION
    plain = to_plain(known)
    assert isinstance(plain, dict)
    return plain


def to_plain(value: Any) -> Any:
    """The same value as JSON knows it: no tuples, paths or numpy scalars; a number that is not finite becomes text."""
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, datetime):
        return value.isoformat()
    return str(value) if isinstance(value, PurePath) else repr(value)


def encode_metadata(metadata: Mapping[str, Any]) -> dict[bytes, bytes]:
    """Schema metadata as Arrow stores it: ``hapticd.<key>`` → JSON."""
    return {
        _PREFIX + key.encode(): json.dumps(to_plain(value), ensure_ascii=False, allow_nan=False).encode()
        for key, value in metadata.items()
    }


def decode_metadata(stored: Mapping[bytes, bytes] | None) -> dict[str, Any]:
    """Inverse of `encode_metadata`; a value that is not JSON is given as text.

    Foreign keys are left out, and what is to be a mapping and is none.
    """
    metadata: dict[str, Any] = {}
    for key, raw in (stored or {}).items():
        if key.startswith(_PREFIX) and key != METADATA_CHECK:
            name = key.removeprefix(_PREFIX).decode(errors="replace")
            value = from_json(raw.decode(errors="replace"))
            if name not in _MAPPINGS or isinstance(value, dict):
                metadata[name] = value
    return metadata
