"""Arguments and options that several commands share, and what their values may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli.completion import complete_config, complete_run, complete_setting
from hapticd.cli.exits import UsageError
from hapticd.control.endpoints import Endpoints, endpoint_of
from hapticd.figures.files import refuse_existing

if TYPE_CHECKING:
    from hapticd.client import Client
    from hapticd.config import Config

SocketOption = Annotated[
    Path | None,
    typer.Option(
        "--socket",
        envvar="HAPTICD_SOCKET",
        metavar="PATH",
        show_default=False,
        help="The daemon's Unix socket. Default: api.socket of the config; to find a daemon, that of the built-in one, or "
        "/run/hapticd/hapticd.sock where only the service listens.",
    ),
]

ForceOption = Annotated[
    bool,
    typer.Option("--force", help=endpoint_of(Endpoints.start).help_of("force")),
]

SettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        show_default=False,
        autocompletion=complete_setting,
        help="Override one setting of the config, e.g. servo.rate_hz=500. Repeatable.",
    ),
]

ConfigArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG",
        show_default=False,
        autocompletion=complete_config,
        help="A YAML file, or a preset by name: re35, delta, omega, freedom6, impulse_engine, mit_toolhandle, phantom, "
        "and rigs that people have: epos4, hapkit, mj5208, srv02. "
        "Default: re35, simulated.",
    ),
]


ModelOption = Annotated[
    str | None,
    typer.Option(
        "--config",
        metavar="CONFIG",
        show_default=False,
        help="Config (file or preset) for a file that carries none; a run's own config always goes first.",
    ),
]


def run_argument(what: str, **more: Any) -> Any:
    """The argument RUN of a command; the command takes it through :func:`hapticd.client.find_run`.

    Args:
        what: what the run is, as its help begins. more: further arguments of `typer.Argument`.
    """
    how = "a file, a name that 'hapticd runs' lists, @last for the newest recording, @last~1 for the one before"
    settings = {"metavar": "RUN", "show_default": False, "autocompletion": complete_run, **more}
    return typer.Argument(help=f"{what}: {how}.", **settings)


RunArgument = Annotated[Path, run_argument("The run")]
RunsArgument = Annotated[
    list[Path] | None, run_argument("Recordings of one device, native, .csv or .parquet", metavar="[RUN]...")
]

FIGURES = frozenset({".png", ".svg", ".pdf"})
_EXPORTED = (".csv", ".parquet", ".mat", ".mcap")


def check_folder(out: Path | None, files: Iterable[str] = (), *, force: bool = False) -> None:
    """Refuse a file where a folder is wanted, and a folder in which no file can be made, before any work is done.

    Args:
        out: the folder. files: what will be written there. force: replace them.

    Raises:
        UsageError: it is one. FileExistsError: a file is there, without ``force``.
    """
    if out is None:
        return
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out} is a file; -o takes a folder")
    from hapticd.record.files import why_unwritable

    if reason := why_unwritable(out):
        raise UsageError(f"{out}: {reason}")
    for name in files:
        refuse_existing(out / name, force=force)


def check_figure_name(out: Path | None, *, force: bool) -> None:
    """Refuse a figure in a format that cannot be drawn, before any work is done.

    Raises:
        UsageError: another suffix than `FIGURES`, or no such folder. FileExistsError: it exists, without ``force``.
    """
    if out is None:
        return
    if out.suffix.lower() not in FIGURES:
        raise UsageError(f"{out}: a figure is a {', '.join(sorted(FIGURES))} file")
    if not out.parent.is_dir():
        raise UsageError(f"{out}: there is no folder {out.parent}")
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give a file name")
    refuse_existing(out, force=force)


def check_run_name(out: Path | None, *, force: bool, source: Path | None = None) -> None:
    """Refuse a run file under the name of something else, or where none can be, before any work is done.

    Raises:
        UsageError: another suffix than ``.arrow``, a folder, or no folder that can be written to.
        FileExistsError: it exists, without ``force``, or is ``source``, which is read.
    """
    if out is None:
        return
    from hapticd.record.files import why_unwritable
    from hapticd.record.listing import SUFFIX

    suffix = out.suffix.lower()
    if suffix != SUFFIX and suffix[1:2].isalpha():  # k0.5 has none
        run = out.with_suffix(SUFFIX)
        export = f", then 'hapticd export {run} --to {suffix[1:]}'" if suffix in _EXPORTED else ""
        raise UsageError(f"{out}: a run file is an Arrow stream; write {run}{export}")
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give a file name")
    if not out.parent.is_dir():
        raise UsageError(f"{out}: there is no folder {out.parent}")
    if reason := why_unwritable(out.parent):
        raise UsageError(f"{out}: {reason}")
    refuse_existing(out, force=force, source=source)


def finite(text: str) -> float:
    """A finite number.

    Raises:
        typer.BadParameter: it is none.
    """
    try:
        value = float(text)
    except ValueError:
        from hapticd.config.text import decimal_comma

        with_point = decimal_comma(text)
        hint = f"; the decimal sign is a point: {with_point}" if with_point else ""
        raise typer.BadParameter(f"{text!r} is not a number{hint}") from None
    if not math.isfinite(value):
        raise typer.BadParameter(f"{text!r} is not a finite number")
    return value


def quantity(text: str) -> str:
    """A finite number with or without a unit (`hapticd.config.units`), as it was written: its size depends on the config.

    Raises:
        typer.BadParameter: it does not begin with a finite number.
    """
    from hapticd.config.units import UnitError, split

    try:
        split(text)
    except UnitError as error:
        raise typer.BadParameter(str(error)) from None
    return text


def duration(text: str) -> float:
    """A duration above zero, in s; a bare number is one.

    Raises:
        typer.BadParameter: it is none.
    """
    from hapticd.config.units import UnitError, seconds

    try:
        value = seconds(text)
    except UnitError as error:
        raise typer.BadParameter(str(error)) from None
    if value <= 0:
        raise typer.BadParameter(f"{text!r} is not above zero")
    return value


def positive(text: str) -> float:
    """A finite number above zero.

    Raises:
        typer.BadParameter: it is none.
    """
    value = finite(text)
    if value <= 0:
        raise typer.BadParameter(f"{text!r} is not above zero")
    return value


def in_unit_of(unit: str) -> Callable[[str], float]:
    """A parser of numbers above zero with or without a unit of that kind; it raises typer.BadParameter."""

    def parse(text: str) -> float:
        from hapticd.config.units import UnitError, in_unit

        try:
            value = in_unit(str(text), unit)
        except UnitError as error:
            raise typer.BadParameter(str(error)) from None
        if value <= 0:
            raise typer.BadParameter(f"{text!r} is not above zero")
        return value

    return parse


def above_zero(text: str) -> str:
    """As `quantity`, above zero.

    Raises:
        typer.BadParameter: it is not.
    """
    from hapticd.config.units import split

    if split(quantity(text))[0] <= 0:
        raise typer.BadParameter(f"{text!r} is not above zero")
    return text


def device_unit(text: str | None, rotary: str, linear: str, is_linear: bool) -> float | None:
    """An option whose unit depends on the device, in SI.

    Raises:
        UnitError: another kind of quantity.
    """
    from hapticd.config.units import in_unit

    return None if text is None else in_unit(text, linear if is_linear else rotary)


Rate = Annotated[float, typer.Option(metavar="HZ", parser=in_unit_of("Hz"))]
Length = Annotated[float, typer.Option(metavar="M", parser=in_unit_of("m"))]
Finite = Annotated[float, typer.Option(parser=finite)]
Positive = Annotated[float, typer.Option(parser=positive)]
Duration = Annotated[float, typer.Option(metavar="S", parser=duration)]
"""In s; a bare number is one."""
Quantity = Annotated[str, typer.Option(parser=quantity)]
"""With or without a unit."""
PositiveQuantity = Annotated[str, typer.Option(parser=above_zero)]
Count = Annotated[int, typer.Option(min=1)]


def parse_settings(assignments: list[str] | None) -> dict[str, str]:
    """``KEY=VALUE`` words as a dict; the values stay text, read as YAML scalars by whoever knows the keys.

    Raises:
        UsageError: a word without ``=`` or without a key, or a key given twice.
    """
    settings: dict[str, str] = {}
    for assignment in assignments or []:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"{assignment!r} is not KEY=VALUE (example: servo.rate_hz=500)")
        if key.strip() in settings:
            raise UsageError(f"{key.strip()} is given twice")
        settings[key.strip()] = value.strip()
    return settings


def resolve_config(source: str | None, assignments: list[str] | None) -> Config:
    """The config of a command line: a file, a preset or the default, with ``--set`` applied.

    Raises:
        ConfigError: anything wrong in it. DriverConfigError: an option that its driver does not have.
        UsageError: a setting that is not KEY=VALUE.
    """
    settings = parse_settings(assignments)
    from hapticd.config import apply_settings, load_config

    config = load_config(source)
    config = apply_settings(config, settings, source="command line") if settings else config
    if config.driver.options or config.safety.enable or config.servo.clock != "grid":
        from drivers import check_option_names

        check_option_names(config)
    return config


def model_of_run(run: Path, model: str | None, assignments: list[str] | None) -> Config:
    """The model that is named, or the one that a recording carries.

    Raises:
        ConfigError: anything wrong in it.
        UsageError: the recording carries none, or ``--set`` without a model.
    """
    if model is not None:
        return resolve_config(model, assignments)
    if assignments:
        raise UsageError("--set changes the model of --model; name one")
    from hapticd.config import parse_config
    from hapticd.record import read_run

    stored = read_run(run).metadata.get("config")
    if not stored:
        raise UsageError(f"{run} carries no config; name the nominal model with --model")
    return parse_config(stored, f"config of {run.name}")


def model_of_daemon(client: Client, model: str | None, assignments: list[str] | None) -> Config:
    """The model that is named, or the daemon's config.

    Raises:
        ConfigError: anything wrong in it.
    """
    if model is not None:
        return resolve_config(model, assignments)
    from hapticd.config import apply_settings, parse_config

    nominal = parse_config(client.config(), "the daemon's config")
    return apply_settings(nominal, parse_settings(assignments)) if assignments else nominal


def guarded(text: str, answer: Mapping[str, Any]) -> str:
    """The text of an answer, and under it the guard's sentence where it has one."""
    guard = answer.get("guard")
    return f"{text}\n{guard['verdict']}: {guard['reason']}" if guard else text


def connect(socket: Path | None) -> Client:
    """A client of the daemon that ``--socket`` or ``HAPTICD_SOCKET`` names, else of the user's own, else of the service."""
    from hapticd.client import Client, DaemonUnreachable

    if socket is None:
        from hapticd.config import paths

        socket = paths.find_socket()
        if reason := paths.foreign(socket.parent):
            raise DaemonUnreachable(f"{reason}; nothing is sent to whoever answers there")
    return Client(socket)
