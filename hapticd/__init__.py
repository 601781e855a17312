"""Stable haptic rendering on one degree of freedom, in real time: the daemon's packages, and their use from Python.

>>> import hapticd
>>> hapticd.check("re35", deflection="30deg").verdict
'stable'

A name is imported when it is first used, so that ``import hapticd`` loads nothing else.
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hapticd.api.runs import load, plot
    from hapticd.api.simulation import simulate
    from hapticd.api.sweeping import sweep
    from hapticd.api.theory import Check, check
    from hapticd.client import Client
    from hapticd.config import Config, ConfigError, load_config
    from hapticd.gap.call import find_gap
    from hapticd.identify.call import identify_plant
    from hapticd.record import Run

_WHERE: Final = {
    "Check": "hapticd.api.theory",
    "Client": "hapticd.client",
    "Config": "hapticd.config",
    "ConfigError": "hapticd.config",
    "Run": "hapticd.record",
    "check": "hapticd.api.theory",
    "find_gap": "hapticd.gap.call",
    "identify_plant": "hapticd.identify.call",
    "load": "hapticd.api.runs",
    "load_config": "hapticd.config",
    "plot": "hapticd.api.runs",
    "simulate": "hapticd.api.simulation",
    "sweep": "hapticd.api.sweeping",
}
"""Public name → module; no package has such a name, since Python binds it to ours when somebody imports it."""

__all__ = [
    "Check",
    "Client",
    "Config",
    "ConfigError",
    "Run",
    "check",
    "find_gap",
    "identify_plant",
    "load",
    "load_config",
    "plot",
    "simulate",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name == "__version__":
        from importlib.metadata import version

        return version("hapticd")
    if name not in _WHERE:
        raise AttributeError(f"module 'hapticd' has no attribute {name!r}")
    _refuse_strangers()
    found = getattr(importlib.import_module(_WHERE[name]), name)
    globals()[name] = found
    return found


def _refuse_strangers() -> None:
    """Refuse to go on where a package of somebody else's has the name of one that is installed with hapticd.

    Raises:
        ImportError: with both places.
    """
    beside = Path(__file__).parents[1]
    found = importlib.util.find_spec("drivers")
    origin = Path(found.origin).parents[1] if found is not None and found.origin else None
    if origin is not None and origin.resolve() != beside.resolve():
        raise ImportError(
            f"another package named 'drivers' in {origin} stands before hapticd's own in {beside}: "
            "start Python in another folder, or give yours another name"
        )


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
