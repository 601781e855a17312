"""The list of steps, in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hapticd.commission import _before, _pulses, _stopping, limits, model

if TYPE_CHECKING:
    from hapticd.commission.rig import Rig
    from hapticd.commission.step import Result


@dataclass(frozen=True)
class Step:
    """One entry of the list.

    Attributes:
        run: does it; its docstring is what a person reads before anything moves.
        moves: whether current flows. needs: names of steps that must have passed.
    """

    name: str
    title: str
    run: Callable[[Rig], Result]
    moves: bool = True
    needs: tuple[str, ...] = ()

    @property
    def will(self) -> str:
        """What it is going to do, in one sentence."""
        return " ".join((self.run.__doc__ or "").split())


STEPS: Final = (
    Step("doctor", "The machine and the config", _before.look_at_machine, moves=False),
    Step("zero_current", "Zero current", _before.hold_zero, needs=("doctor",)),
    Step("by_hand", "The shaft turned by hand", _before.turn_by_hand, needs=("zero_current",)),
    Step("sign", "Which way a current turns it", _pulses.sign, needs=("by_hand",)),
    Step("torque_constant", "Torque constant", _pulses.known_load, needs=("sign",)),
    Step("latency", "From command to motion", _pulses.delay, needs=("sign",)),
    Step("watchdog", "The device's watchdog", _stopping.watchdog, needs=("sign",)),
    Step("estop", "Emergency stop", limits.estop, needs=("sign",)),
    Step("enable", "The enable that a person holds", limits.enable, needs=("sign",)),
    Step("current_loop", "The current loop", _stopping.current_loop, needs=("sign",)),
    Step("trips", "Trips of speed and excursion", limits.trips, needs=("estop",)),
    Step("identify", "Identification", model.identify, needs=("trips",)),
    Step("gap", "What the model lacks", model.gap, moves=False, needs=("identify",)),
    Step("fig_8", "The paper's four releases", model.fig_8, needs=("identify",)),
    Step("stiffness", "The largest stiffness", model.largest_stiffness, needs=("identify",)),
)
NAMES: Final = tuple(step.name for step in STEPS)
