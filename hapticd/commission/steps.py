"""The list of steps, in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hapticd.commission import before, limits, model, pulses, stopping

if TYPE_CHECKING:
    from hapticd.commission.rig import Rig
    from hapticd.commission.step import Result


@dataclass(frozen=True)
class Step:
    """One entry of the list.

    Attributes:
        will: one sentence, shown before anything moves. run: does it.
        moves: whether current flows. needs: names of steps that must have passed.
    """

    name: str
    title: str
    will: str
    run: Callable[[Rig], Result]
    moves: bool = True
    needs: tuple[str, ...] = ()


STEPS: Final = (
    Step(
        "doctor",
        "The machine and the config",
        "Looks at this machine's kernel, limits and ports, and whether the config has the limits that a safe motion needs; "
        "nothing moves.",
        before.look_at_machine,
        moves=False,
    ),
    Step(
        "zero_current",
        "Zero current",
        "Switches the amplifier on at zero current for 1.5 s; the shaft should stand where it is.",
        before.hold_zero,
        needs=("doctor",),
    ),
    Step(
        "by_hand",
        "The shaft turned by hand",
        "Asks you to turn the shaft once to and fro at zero current, and watches the counter: direction, resolution, jumps, "
        "index, friction.",
        before.turn_by_hand,
        needs=("zero_current",),
    ),
    Step(
        "sign",
        "Which way a current turns it",
        "Gives a hundredth, then a tenth of the rated current for 50 ms, to one side and back; hands off.",
        pulses.sign,
        needs=("by_hand",),
    ),
    Step(
        "torque_constant",
        "Torque constant",
        "Holds a weight that you hang on, lifts it by a quarter of a radian (2.5 mm) in 2 s and lets it down again.",
        pulses.known_load,
        needs=("sign",),
    ),
    Step(
        "latency",
        "From command to motion",
        "Gives six pulses of 15 ms, each braked by its opposite, and times when the motion begins.",
        pulses.delay,
        needs=("sign",),
    ),
    Step(
        "watchdog",
        "The device's watchdog",
        "Accelerates the shaft gently, then says nothing more, and times when the device takes the current away by itself.",
        stopping.watchdog,
        needs=("sign",),
    ),
    Step(
        "estop",
        "Emergency stop",
        "Starts a daemon, swings the shaft at 5 Hz, sends estop, and times zero current and the end of the push.",
        limits.estop,
        needs=("sign",),
    ),
    Step(
        "enable",
        "The enable that a person holds",
        "Asks you to let go of the enable and to hold it again, first with the amplifier off, then while the shaft swings.",
        limits.enable,
        needs=("sign",),
    ),
    Step(
        "current_loop",
        "The current loop",
        "Steps a quarter of the rated current to and fro for 20 ms, eight times, and looks at the current that the device "
        "measures.",
        stopping.current_loop,
        needs=("sign",),
    ),
    Step(
        "trips",
        "Trips of speed and excursion",
        "Sets both limits to a twentieth, and lets current steps run beyond them.",
        limits.trips,
        needs=("estop",),
    ),
    Step(
        "identify",
        "Identification",
        "Plays chirps that grow until the shaft moves, then two of 12 s within the limits, and finds inertia, friction and "
        "delay.",
        model.identify,
        needs=("trips",),
    ),
    Step(
        "gap",
        "What the model lacks",
        "Compares the recordings with the identified model and names what is missing; nothing moves.",
        model.gap,
        moves=False,
        needs=("identify",),
    ),
    Step(
        "fig_8",
        "The paper's four releases",
        "Releases the shaft four times as in Fig. 8; the last of them grows on purpose until the over-speed trip ends it.",
        model.fig_8,
        needs=("identify",),
    ),
    Step(
        "stiffness",
        "The largest stiffness",
        "Releases the shaft for 1 s each at a stiffness that grows from a quarter of what theory admits, until one does not "
        "come to rest.",
        model.largest_stiffness,
        needs=("identify",),
    ),
)
NAMES: Final = tuple(step.name for step in STEPS)
