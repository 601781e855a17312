"""Arguments and options that several commands share, and the text under every help page."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import output
from hapticd.cli.completion import complete_config, complete_setting
from hapticd.cli.exits import MEANING, UsageError
from hapticd.control.endpoints import Endpoints, endpoint_of

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

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON document on stdout; everything else goes to stderr.")
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
        help="A YAML file, or a preset by name: re35, delta, omega, freedom6, impulse_engine, mit_toolhandle, phantom. "
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

FIGURES = frozenset({".png", ".svg", ".pdf"})


def output_option(metavar: str, text: str) -> Any:
    """``-o`` of a command that writes one file."""
    return typer.Option("-o", "--output", metavar=metavar, show_default=False, help=text)


def folder_option(holds: str) -> Any:
    """``-o DIR`` of a command that writes several files; :func:`check_folder` looks at what was given."""
    return output_option("DIR", f"Folder for {holds}; made if missing.")


def quantity_option(flag: str, metavar: str, text: str) -> Any:
    """A :func:`quantity` with or without a unit."""
    return typer.Option(flag, parser=quantity, metavar=metavar, show_default=False, help=text)


def duration_option(text: str) -> Any:
    """``--duration``, see :func:`duration`."""
    return typer.Option("--duration", parser=duration, metavar="S", show_default=False, help=text)


def only_option(what: str) -> Any:
    """``--only NAME`` of a command that does several things."""
    return typer.Option("--only", metavar="NAME", show_default=False, help=f"Only {what}. Repeatable.")


def check_folder(out: Path | None) -> None:
    """Refuse a file where a folder is wanted.

    Raises:
        UsageError: it is one.
    """
    if out is not None and out.exists() and not out.is_dir():
        raise UsageError(f"{out} is a file; -o takes a folder")


def check_figure_name(out: Path | None) -> None:
    """Refuse a figure in a format that cannot be drawn, before any work is done.

    Raises:
        UsageError: another suffix than `FIGURES`, or no such folder.
    """
    if out is None:
        return
    if out.suffix.lower() not in FIGURES:
        raise UsageError(f"{out}: a figure is a {', '.join(sorted(FIGURES))} file")
    if not out.parent.is_dir():
        raise UsageError(f"{out}: there is no folder {out.parent}")


QuietOption = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Say nothing beside the answer but warnings and errors: no progress, no notes."),
]


def _with_quiet(function: Callable[..., int]) -> Callable[..., int]:
    """The command with ``--quiet``, which is the same for all."""

    @functools.wraps(function)
    def command(*, quiet: bool = False, **values: Any) -> int:
        output.quiet.set(quiet)
        return function(**values)

    signature = inspect.signature(function, eval_str=True)
    option = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=QuietOption)
    parameters = [*signature.parameters.values(), option]
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command


def register(
    app: typer.Typer,
    function: Callable[..., int],
    *examples: str,
    codes: tuple[int, ...],
    name: str | None = None,
    endpoint: Callable[..., Any] | None = None,
) -> None:
    """Add a command whose help is the function's docstring, flowed to the terminal's width, with :func:`epilog` below.

    The help of an endpoint's command is the endpoint's, and below it what the function's docstring adds.

    Args:
        app: where to add it.
        function: the command; returns its exit code.
        examples: command lines.
        codes: the exit codes it can end with.
        name: its name, if not the function's.
        endpoint: method of `Endpoints`, for a command that asks for one.
    """
    declared = endpoint_of(endpoint) if endpoint else None
    texts = [declared.description if declared else "", inspect.cleandoc(function.__doc__ or "")]
    paragraphs = "\n\n".join(filter(None, texts)).split("\n\n")
    text = "\n\n".join(paragraph.replace("\n", " ") for paragraph in paragraphs).replace("[", "\\[")
    app.command(name or (declared.name if declared else None), help=text, epilog=epilog(*examples, codes=codes))(
        _with_quiet(function)
    )


def epilog(*examples: str, codes: tuple[int, ...]) -> str:
    """The text under a help page: examples, then what each exit code of this command means."""
    shown = "\n".join(f"  {example}" for example in examples).replace("[", "\\[")
    return f"Examples:\n{shown}\n\nExit codes:\n" + "\n".join(f"  {code}  {MEANING[code]}" for code in codes)


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
        ConfigError: anything wrong in it.
        UsageError: a setting that is not KEY=VALUE.
    """
    settings = parse_settings(assignments)
    from hapticd.config import apply_settings, load_config

    config = load_config(source)
    return apply_settings(config, settings, source="command line") if settings else config


def motion_of(config: Config, deflection: str | None, velocity: str | None) -> tuple[float | None, float | None]:
    """``--deflection`` in coarse ticks and ``--velocity`` in coarse ticks per period, whatever their units were.

    Raises:
        UnitError: an unknown unit, or one of the other kind of device.
    """
    from hapticd.config.units import deflection_ticks, velocity_ticks

    return (
        None if deflection is None else deflection_ticks(deflection, config),
        None if velocity is None else velocity_ticks(velocity, config),
    )


def guarded(text: str, answer: Mapping[str, Any]) -> str:
    """The text of an answer, and under it the guard's sentence where it has one."""
    guard = answer.get("guard")
    return f"{text}\n{guard['verdict']}: {guard['reason']}" if guard else text


def connect(socket: Path | None) -> Client:
    """A client of the daemon that ``--socket`` or ``HAPTICD_SOCKET`` names, else of the user's own, else of the service."""
    from hapticd.client import Client, DaemonUnreachable

    if socket is None:
        from hapticd.config import places

        socket = places.find_socket()
        if reason := places.foreign(socket.parent):
            raise DaemonUnreachable(f"{reason}; nothing is sent to whoever answers there")
    return Client(socket)
