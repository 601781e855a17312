"""``hapticd hil``: the daemon against simulated hardware in a process of its own, compared with the simulation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import SettingsOption, check_folder, parse_settings, resolve_config
from hapticd.figures.files import write_text

if TYPE_CHECKING:
    from hapticd.config import Config

HilConfigArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="[CONFIG]",
        show_default=False,
        help="A YAML file whose driver is serial_dac or canopen: the daemon's config. May be left out with --device "
        "firmware: the built-in testbed.",
    ),
]


@command(
    "hapticd hil examples/serial-board.yaml",
    "hapticd hil examples/canopen-drive.yaml --set driver.interface=unix_seqpacket -o report",
    "hapticd hil examples/serial-board.yaml --fault-matrix --only sigkill",
    "hapticd hil --device firmware",
    "hapticd hil --device firmware --fault-matrix",
    codes=(exits.NO, exits.DEVICE, exits.INTERRUPTED),
)
def hil(
    config: HilConfigArgument = None,
    device: str = "simulated",
    board: str = "mps2-an385",
    plant: str | None = None,
    out: Path | None = None,
    fault_matrix: bool = False,
    only: list[str] | None = None,
    force: bool = False,
    assignments: SettingsOption = None,
) -> int:
    """Hardware in the loop: run the daemon on simulated hardware, and compare with the simulation.

    Starts the simulated board or drive that CONFIG's driver asks for, and the daemon on it, both as processes of their own,
    as a user would. Does the four releases of the paper's Fig. 8 and an excitation, and compares outcome, place of rest
    and current with 'simulate'. The delay from encoder sample to current is read from the device's own log and judged
    against the one that the driver declares.

    With --fault-matrix every fault is injected instead, each on a fresh device and daemon: which code was raised, when
    the current was zero according to the device, and what the recording lost.

    With --device firmware the same runs against the firmware that 'make firmware' has built, in emulation. An emulated
    processor is no measure of time, so all runs at 200 Hz, on a rig slowed down until inertia, friction and delay are in
    periods and ticks what they are at the rate of each case: mu, beta and sigma are the paper's.

    Args:
        device (KIND): simulated: the board or drive of CONFIG's driver, in Python. firmware: the serial board's
            reference firmware as a binary in emulation, at 200 Hz.
        board (NAME): Board of --device firmware: mps2-an385 (QEMU), host or avr-uno.
        plant (FILE): Config whose plant, amplifier, encoder and hand the simulated device has. Default: CONFIG's own.
        out (-o, --output DIR): Folder for report.html, recordings and logs; made if missing.
        fault_matrix: Inject every fault, one after the other, instead of the experiments.
        only (NAME): Only this case (a, b, c, d, excitation) or fault. Repeatable.
        force: Replace an earlier report in DIR, with its recordings and logs.
    """
    if device not in ("simulated", "firmware"):
        raise UsageError(f"--device {device}: unknown (known: simulated, firmware)")
    on_board = board if device == "firmware" else None
    resolved = _resolved(config, assignments, on_board)
    device_plant = resolve_config(plant, None) if plant else None
    from hapticd.hil.page import PAGE

    matrix_name = f"fault-matrix-{on_board or resolved.driver.name}.md"
    check_folder(out, [matrix_name if fault_matrix else PAGE], force=force)
    if fault_matrix:
        if plant is not None:
            raise UsageError("--plant goes with the experiments; the fault matrix runs on CONFIG's own plant")
        return _matrix(resolved, out and out / matrix_name, only, on_board)
    if on_board and plant is not None:
        raise UsageError("--plant goes with simulated devices; the firmware's rig is CONFIG's own")
    from hapticd.hil.cases import FIG_8
    from hapticd.hil.suite import run_suite
    from hapticd.hil.text import suite_document, suite_text

    known = [*(case.name for case in FIG_8), *(() if on_board else ("excitation",))]
    _check_names(only, known)
    with output.progress_bar("hil") as bar:
        result = run_suite(
            resolved,
            plant=device_plant,
            cases=[case for case in FIG_8 if not only or case.name in only],
            with_excitation=not on_board and (not only or "excitation" in only),
            board=on_board,
            keep=out,
            progress=bar,
        )
    document: dict[str, Any] = suite_document(result)
    text = suite_text(result)
    if out is not None:
        from hapticd.hil.page import write_page

        document["page"] = write_page(result, out)
        text += f"\n{document['page']}"
    output.emit(document, text)
    return exits.DONE if result.agrees else exits.NO


def _resolved(config: str | None, assignments: list[str] | None, board: str | None) -> Config:
    """The daemon's config; the built-in testbed on the firmware where none is given."""
    if config is None and not board:
        raise UsageError("CONFIG is missing: a YAML file whose driver is serial_dac or canopen")
    if config is not None:
        resolved = resolve_config(config, assignments)
    else:
        from hapticd.config import apply_settings, parse_config
        from hapticd.hil.cases import FIRMWARE_CONFIG

        resolved = parse_config(FIRMWARE_CONFIG, "the testbed on the firmware")
        if settings := parse_settings(assignments):
            resolved = apply_settings(resolved, settings, source="command line")
    if board and resolved.driver.name != "serial_dac":
        raise UsageError(f"driver.name = {resolved.driver.name}: the firmware is a serial board's, serial_dac")
    return resolved


def _matrix(config: Config, out: Path | None, only: list[str] | None, board: str | None) -> int:
    from hapticd.hil.injections import INJECTIONS
    from hapticd.hil.matrix import run_matrix
    from hapticd.hil.text import matrix_document, matrix_markdown, matrix_text

    if board is not None:
        from hapticd.hil.cases import FIRMWARE_RATE_HZ, slower_rig

        config = slower_rig(config, config.servo.rate_hz, FIRMWARE_RATE_HZ)
    possible = [injection for injection in INJECTIONS if config.driver.name in injection.devices]
    if possible:  # else the device itself says which drivers have one
        _check_names(only, [injection.name for injection in possible])
    chosen = [injection for injection in possible if not only or injection.name in only]
    with output.progress_bar("faults") as bar:
        rows = run_matrix(config, injections=chosen, board=board, progress=bar)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_text(out, matrix_markdown(rows))
    document = matrix_document(rows)
    output.emit(document, matrix_text(rows))
    return exits.DONE if document["met"] else exits.NO


def _check_names(only: list[str] | None, known: list[str]) -> None:
    for name in only or ():
        if name not in known:
            raise UsageError(f"--only {name}: unknown (known: {', '.join(known)})")
