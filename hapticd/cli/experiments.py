"""``release`` and ``excite``: experiments that the daemon runs while we wait and show how far it is."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_experiment
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Duration, ForceOption, Quantity, Rate, SocketOption, check_run_name, connect, guarded
from hapticd.cli.output import number
from hapticd.control.endpoints import Endpoints
from hapticd.figures.files import atomic_write

if TYPE_CHECKING:
    from hapticd.client import Client
    from hapticd.servo.experiment import Experiment

NameArgument = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        autocompletion=complete_experiment,
        help="Which experiment; --list names them. Or a file, as 'hapticd gap' writes it.",
    ),
]

SequenceArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A list of settings, one release each (YAML).")]


@command(
    "hapticd release --deflection 20.3",
    "hapticd release --deflection 30deg -o wall.arrow",
    "hapticd release --deflection -3 --duration 2 --json",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT, exits.INTERRUPTED),
    endpoint=Endpoints.release,
)
def _release(
    deflection: Quantity,
    duration_s: Duration | None = None,
    out: Path | None = None,
    no_wait: bool = False,
    force: ForceOption = False,
    socket: SocketOption = None,
) -> int:
    """Ctrl-C stops the daemon's rendering.

    Args:
        deflection (TICKS): Or with a unit: 0.5rad, 30deg, 2mm, 217counts.
        duration_s (--duration): Or with a unit: 500ms, 2min.
        out (-o, --output RUN): Copy the recording to this file (.arrow) when it is over. It stays in record.directory,
            too.
        no_wait: Return as soon as the experiment has begun.
    """
    _check_copy(out, no_wait)
    client = connect(socket)
    begin = partial(client.release, _in_ticks(deflection, client), duration_s, force)
    return _follow(client, "release", begin, no_wait, describe_release, out)


@command(
    "hapticd excite --list",
    "hapticd excite",
    "hapticd excite chirp --amplitude 0.2 --duration 10 -o chirp.arrow",
    "hapticd excite chirp --low 5 --high 200",
    "hapticd excite gap/next_experiment.yaml",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT, exits.INTERRUPTED),
    endpoint=Endpoints.excite,
)
def _excite(
    name: NameArgument = "all",
    amplitude: Quantity | None = None,
    duration_s: Duration | None = None,
    low_hz: Rate | None = None,
    high_hz: Rate | None = None,
    out: Path | None = None,
    show_list: bool = False,
    no_wait: bool = False,
    force: ForceOption = False,
    socket: SocketOption = None,
) -> int:
    """Ctrl-C stops the experiment and the rendering.

    NAME may be a YAML file with the keys excitation, amplitude, duration_s, low_hz and high_hz (of a chirp), seed, and
    settings: live settings that are in force while it is played and taken back after it.

    Args:
        amplitude (A|RAD|M): Or with a unit: 200mA, 30deg.
        duration_s (--duration): Or with a unit: 500ms, 2min.
        low_hz (--low HZ): Or with a unit: 500mHz.
        high_hz (--high HZ): Or with a unit: 0.2kHz. At most a quarter of servo.rate_hz.
        out (-o, --output RUN): Copy the recording to this file (.arrow) when it is over. It stays in record.directory,
            too.
        show_list (--list): List the experiments and exit; needs no daemon.
        no_wait: Return as soon as the experiment has begun.
    """
    if show_list:
        _list()
        return exits.DONE
    from hapticd.client import settings_for_a_while

    client = connect(socket)
    experiment = experiment_named(name, _peak(name, amplitude, client), duration_s, low_hz, high_hz)
    if no_wait and experiment.settings:
        raise UsageError(f"{name}: --no-wait cannot be kept, its settings must be taken back at the end")
    _check_copy(out, no_wait)
    with settings_for_a_while(client, experiment.settings, force):
        begin = partial(client.excite, experiment.excitation, force=force, **experiment.plan())
        return _follow(client, experiment.excitation, begin, no_wait, _text, out)


@command(
    "hapticd sequence stiffness.yaml",
    "hapticd sequence stiffness.yaml --json",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT, exits.INTERRUPTED),
    endpoint=Endpoints.sequence,
)
def _sequence(
    file: SequenceArgument,
    no_wait: bool = False,
    force: ForceOption = False,
    socket: SocketOption = None,
) -> int:
    """Ctrl-C stops the sequence and the rendering.

    FILE is YAML: name, deflection (ticks, or text with a unit), duration_s, repeat, and steps, a list of mappings of dotted
    live keys, each of which may have a deflection and a duration_s of its own. 'hapticd runs --where sequence=NAME' lists
    its recordings.

    Args:
        no_wait: Return as soon as the first step has begun.
    """
    from hapticd.config import parse_config
    from hapticd.config.reading import read_text
    from hapticd.servo.sequence import read_sequence

    sequence = read_sequence(read_text(file, str(file)), str(file))
    client = connect(socket)
    fields = sequence.request(parse_config(client.config(), "the daemon's config"))
    return _follow(
        client, "sequence", partial(client.sequence, **fields, force=force), no_wait, describe_sequence, None
    )


def _in_ticks(deflection: str, client: Client) -> float:
    """A deflection in coarse ticks of the config in force; the daemon is asked for it where there is a unit."""
    from hapticd.config import parse_config
    from hapticd.config.units import deflection_ticks, split

    value, unit = split(deflection)
    if not unit:
        return value
    return deflection_ticks(deflection, parse_config(client.config(), "the daemon's config"))


def _peak(name: str, amplitude: str | None, client: Client) -> float | None:
    """An amplitude in A, or in rad or m where the experiment moves the spring's origin.

    Raises:
        UsageError: not above zero, or with a unit for experiments of both kinds.
        UnitError: a unit that this experiment cannot have.
    """
    if amplitude is None:
        return None
    from hapticd.config import parse_config, units

    peak, unit = units.split(amplitude)
    if peak <= 0:
        raise UsageError(f"--amplitude {amplitude} is not above zero")
    if not unit:
        return peak
    from hapticd.servo.excitation import ALL, SHAPES

    if name == ALL:
        raise UsageError(f"--amplitude {amplitude}: '{ALL}' has amplitudes of several kinds; name one experiment")
    moves = name in SHAPES and SHAPES[name].moves_origin
    return units.amplitude(amplitude, parse_config(client.config(), "the daemon's config"), moves_origin=moves)


def experiment_named(
    name: str,
    amplitude: float | None = None,
    duration_s: float | None = None,
    low_hz: float | None = None,
    high_hz: float | None = None,
) -> Experiment:
    """What a name or a file stands for.

    Args:
        name: of an excitation, or a file.
        amplitude, duration_s: A (or rad, m) and s. low_hz, high_hz: of a chirp. None: the daemon's choice.

    Raises:
        ConfigError: anything wrong in the file.
        UsageError: numbers are given beside a file.
    """
    from hapticd.servo.experiment import Experiment, names_file, read_experiment

    if not names_file(name):
        return Experiment(name, amplitude, duration_s, low_hz, high_hz)
    if any(given is not None for given in (amplitude, duration_s, low_hz, high_hz)):
        raise UsageError(f"{name}: amplitude, duration_s, low_hz and high_hz stand in the file")
    return read_experiment(Path(name))


def _list() -> None:
    from hapticd.servo.excitation import ALL, SHAPES

    shapes = [
        {
            "name": shape.name,
            "summary": shape.summary,
            "duration_s": shape.duration_s,
            "amplitude_unit": "rad or m" if shape.moves_origin else "A",
        }
        for shape in SHAPES.values()
    ]
    lines = [
        f"{s['name']:8} {s['summary']} ({s['duration_s']:g} s, amplitude in {s['amplitude_unit']})" for s in shapes
    ]
    lines.append(f"{ALL:8} all of them, one after the other, in one recording (the default)")
    output.emit({"experiments": shapes, "default": ALL}, "\n".join(lines))


def _follow(
    client: Client,
    name: str,
    begin: Callable[[], dict[str, Any]],
    no_wait: bool,
    text: Callable[[dict[str, Any]], str],
    out: Path | None,
) -> int:
    """Begin a job, wait for its end, and report it."""
    from hapticd.client import stop_on_interrupt

    with stop_on_interrupt(client, output.note):
        job = begin()
        if no_wait:
            output.emit(job, text(job))
            return exits.DONE
        with output.progress_bar(name) as progress:
            report = client.wait(job["experiment"], progress)
    answer = {**job, "state": report["state"], "result": report["result"]}
    if out is not None:
        answer = _copied(answer, out)
    output.emit(answer, text(answer))
    if (report["result"] or {}).get("fault"):
        return exits.FAULT
    return exits.DONE if report["state"] == "done" else exits.NO


def _check_copy(out: Path | None, no_wait: bool) -> None:
    """Refuse a copy of the recording that could not be made, before anything moves.

    Raises:
        UsageError: the file exists, its folder does not, or nobody would wait for the recording's end.
    """
    if out is None:
        return
    if no_wait:
        raise UsageError(f"-o {out}: --no-wait returns before the recording is over; leave one of them out")
    if out.exists():
        raise UsageError(f"{out} exists: a recording never overwrites a file")
    check_run_name(out, force=False)


def _copied(answer: dict[str, Any], out: Path) -> dict[str, Any]:
    """The answer with the copy of its recording: the daemon may be somebody else's and not see this folder."""
    source = Path((answer["result"] or {}).get("run") or answer["run"])
    try:
        with atomic_write(out) as part:
            shutil.copyfile(source, part)
    except OSError as error:
        output.warn(f"the recording is {source}; it cannot be copied to {out}: {error.strerror or error}")
        return answer
    return {**answer, "copy": str(out)}


def describe_release(answer: dict[str, Any]) -> str:
    """A release in a few lines: what became of it, where it ended, where the recording is."""
    found = answer.get("result") or {}
    lines = [f"deflection   {number(answer['achieved_deflection'], 6)} ticks"]
    if found.get("held_by_friction"):
        lines.append("outcome      held by friction: the shaft did not move")
    elif found.get("outcome"):
        rest = found.get("rest")
        after = f", at rest after {number(rest['after_s'], 3)} s ({rest['after_periods']} periods)" if rest else ""
        lines.append(f"outcome      {found['outcome']}{after}")
    if final := found.get("final"):
        lines.append(f"final        {number(final['position_ticks'], 6)} ticks")
    if swing := found.get("oscillation"):
        rate = f" at {number(swing['frequency_hz'], 4)} Hz" if swing["frequency_hz"] else ""
        ticks, counts = number(swing["peak_to_peak_ticks"], 4), number(swing["peak_to_peak_counts"], 6)
        lines.append(f"oscillation  {ticks} ticks ({counts} counts) peak to peak{rate}")
    lines += [f"{key:<11}  {found[key]}" for key in ("fault", "error") if found.get(key)]
    lines.append(f"recorded     {number(answer['duration_s'], 4)} s in {answer['run']}")
    if copy := answer.get("copy"):
        lines.append(f"copied to    {copy}")
    if answer.get("state", "done") != "done":
        lines.append(f"experiment   {answer['experiment']} {answer['state']}")
    return guarded("\n".join(lines), answer)


def describe_sequence(answer: dict[str, Any]) -> str:
    """A sequence: a line for each release, and what ended it before its last one."""
    found = answer.get("result") or {}
    lines = [f"sequence {answer['sequence']}: {len(found.get('runs', ()))} of {answer['steps']} releases"]
    for number_of, run in enumerate(found.get("runs", ()), 1):
        settings = " ".join(f"{key}={value}" for key, value in run["settings"].items())
        outcome = "held by friction" if run["held_by_friction"] else run["outcome"] or "-"
        deflection = f"{number(run['achieved_deflection'], 6)} ticks"
        lines.append(f"{number_of:4}  {deflection:>14}  {outcome:16}  {Path(run['run']).name}  {settings}".rstrip())
    lines += [f"{key}  {found[key]}" for key in ("fault", "error") if found.get(key)]
    if answer.get("state", "done") != "done":
        lines.append(f"experiment {answer['experiment']} {answer['state']}")
    return guarded("\n".join(lines), answer)


def _text(answer: dict[str, Any]) -> str:
    shown = _flat({**answer, **(answer.get("result") or {}), "result": None, "guard": None})
    width = max(len(key) for key in shown)
    return guarded("\n".join(f"{key:{width}}  {value}" for key, value in shown.items()), answer)


def _flat(answer: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested keys joined by dots; what is not known is left out."""
    flat: dict[str, Any] = {}
    for key, value in answer.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        elif value is not None:
            flat[f"{prefix}{key}"] = value
    return flat
