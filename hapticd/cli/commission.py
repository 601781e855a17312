"""``hapticd commission``: a rig's first day, step by step, with a page that proves it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_config
from hapticd.cli.exits import UsageError
from hapticd.cli.options import PositiveQuantity, SettingsOption, check_folder, device_unit, resolve_config

if TYPE_CHECKING:
    from hapticd.commission.step import Result
    from hapticd.commission.steps import Step
    from hapticd.doctor.board import Operator

RigArgument = Annotated[
    str,
    typer.Argument(metavar="CONFIG", show_default=False, autocompletion=complete_config, help="The rig's YAML file."),
]
_GRAVITY = 9.80665
_SIGNS = {"pass": "ok  ", "fail": "BAD ", "skipped": "--  ", "disturbed": "??  "}


@command(
    "hapticd commission rig.yaml -o first-day",
    "hapticd commission rig.yaml -o first-day --weight 0.1kg --arm 20mm",
    "hapticd commission rig.yaml -o first-day --again watchdog",
    "hapticd commission simulated.yaml --yes --json",
    codes=(exits.NO, exits.DEVICE, exits.INTERRUPTED),
)
def commission(
    config: RigArgument,
    out: Path = Path("commission"),
    again: list[str] | None = None,
    only: list[str] | None = None,
    weight: PositiveQuantity | None = None,
    arm: PositiveQuantity | None = None,
    torque: PositiveQuantity | None = None,
    inertia: PositiveQuantity | None = None,
    yes: bool = False,
    force: bool = False,
    assignments: SettingsOption = None,
) -> int:
    """A rig's first day in one command: from the machine's doctor to the largest stiffness, one step after another.

    Each step says what it will do before anything moves, asks, and ends in a result, a limit and a picture: machine and
    config; zero current; the shaft turned by hand; the sign of the current; the torque constant, by a known weight; the
    delay from command to motion; the watchdog; estop; the enable; the current loop; the trips; identify; gap; the four
    releases of Fig. 8; the largest stiffness by theory and by trial.

    A step that finds what makes motion dangerous (a wrong sign, ten times the current, a dead watchdog) ends all that
    moves. No daemon may run on the rig: the steps hold the driver themselves, then start a daemon of their own.

    DIR keeps the state: Ctrl-C leaves zero current, and the same command goes on with what has not passed. Results of
    another config are replaced with --force alone. In the end DIR has commission.html, commission.json and identified.yaml.

    Args:
        out (-o, --output DIR): Folder of state, recordings, page and certificate.
        again (STEP): Run this step though it has passed, and what needs it. Repeatable.
        only (STEP): Run only this step. Repeatable.
        weight (KG): Mass of a weight for the torque constant; goes with --arm on a rotary device.
        arm (M): Radius of the pulley, or arm at which the weight hangs.
        torque (N_M): Torque (or force) of a drawn spring in place of a weight.
        inertia (KG_M2): Inertia, where you know it: then identify says which torque constant it needs.
        yes: Ask nothing: nobody is at the terminal, or the rig is simulated.
        force: Replace results in DIR of another config, or of which it holds no state.
    """
    if not yes and not sys.stdin.isatty():
        raise UsageError("nobody is at a terminal to be asked; --yes if the rig may move without a question")
    resolved = resolve_config(config, assignments)
    from hapticd.commission.certificate import FILE as CERTIFICATE
    from hapticd.commission.certificate import certificate
    from hapticd.commission.page import PAGE, write_page
    from hapticd.commission.rig import IDENTIFIED, Given, Rig
    from hapticd.commission.run import STATE, State
    from hapticd.commission.run import commission as run
    from hapticd.commission.steps import NAMES
    from hapticd.figures.files import write_text

    own = (out / STATE).exists() and not State(out, resolved).forgotten
    check_folder(out, () if own else (STATE, PAGE, CERTIFICATE, IDENTIFIED), force=force)
    for name in (*(again or ()), *(only or ())):
        if name not in NAMES:
            raise UsageError(f"{name}: no such step (known: {', '.join(NAMES)})")
    linear = resolved.is_linear
    load = device_unit(torque, "N m", "N", linear)
    if weight is not None:
        mass, radius = device_unit(weight, "kg", "kg", linear), device_unit(arm, "m", "m", linear)
        if torque is not None or (radius is None) != linear:
            raise UsageError(
                "--weight goes with --arm on a rotary device, without on a linear one, and not with --torque"
            )
        load = (mass or 0.0) * _GRAVITY * (radius or 1.0)
    elif arm is not None:
        raise UsageError("--arm goes with --weight")
    given = Given(load, device_unit(inertia, "kg m²", "kg", linear))
    operator = _Agreed() if yes else _terminal()
    rig = Rig(resolved, out.resolve(), operator, output.note, output.progress_bar, given)
    interrupted = False
    try:
        with rig:
            run(rig, again=again or (), only=only or (), told=_tell)
    except KeyboardInterrupt:
        output.note("zero current; the state is kept, and the same command goes on")
        interrupted = True
    document = certificate(rig)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / CERTIFICATE, output.to_json(document))
    document["page"] = write_page(rig, document, out)
    found = (
        f"failed: {', '.join(document['failed'])}" if document["failed"] else "passed" if document["passed"] else "open"
    )
    output.emit(document, f"{found}; {document['rig_s']:.0f} s at the rig\n{document['page']}")
    return exits.INTERRUPTED if interrupted else exits.DONE if document["passed"] else exits.NO


class _Agreed:
    """Nobody to be asked, and everything agreed to."""

    def agrees(self, question: str) -> bool:
        return True

    def does(self, request: str) -> bool:
        output.note(request)
        return True

    def shows(self, counts: int, rate: float, fastest: float) -> None:
        pass


def _terminal() -> Operator:
    from hapticd.cli.doctor import Terminal

    return Terminal()


def _tell(step: Step, result: Result) -> None:
    output.note(f"{_SIGNS[result.result]}{step.name}: {result.finding}")
    for word, text in (("likely", result.cause), ("to do", result.remedy)):
        if text:
            output.note(f"    {word}: {text}")
