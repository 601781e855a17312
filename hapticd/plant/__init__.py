"""The device: exact propagation, friction, amplifier, encoder, an operator's hand.

The public names below are imported at first use, because some modules need no compiled code.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hapticd.plant.amplifier import quantise_current
    from hapticd.plant.device import Plant
    from hapticd.plant.exact import propagate
    from hapticd.plant.spring import propagate_with_stiffness

__all__ = [
    "Plant",
    "propagate",
    "propagate_with_stiffness",
    "quantise_current",
]

_MODULES = {
    "Plant": "device",
    "propagate": "exact",
    "propagate_with_stiffness": "spring",
    "quantise_current": "amplifier",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
