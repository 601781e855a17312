"""How a command is declared: its function, with the options in the docstring; examples and exit codes above it."""

from __future__ import annotations

import copy
import functools
import inspect
import operator
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, get_args, get_origin

import typer

from hapticd.cli import exits, output
from hapticd.cli.exits import DONE, MEANING, USAGE
from hapticd.control.endpoints import Endpoint, endpoint_of

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON document on stdout; everything else goes to stderr.")
]
QuietOption = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Say nothing beside the answer but warnings and errors: no progress, no notes."),
]
Command = Callable[..., int | None]
_COMMAND = "__command__"
_OPTION = re.compile(r"(\w+)(?: \((.+?)\))?: (.+)", re.DOTALL)


def command(
    *examples: str,
    codes: tuple[int, ...] = (),
    name: str | None = None,
    endpoint: Callable[..., Any] | None = None,
    json: bool = True,
) -> Callable[[Command], Command]:
    """Declare a command whose help is the function's docstring, flowed to the terminal's width, with :func:`epilog` below.

    The function returns the exit code, None for 0. The help of an endpoint's command is the endpoint's, and below it what
    the function's docstring adds. Under ``Args`` the docstring has the command's own options, each as
    ``parameter (flags METAVAR): help``; without flags, its flag is the parameter's name. Every command has ``--json`` and
    ``--quiet``.

    Args:
        examples: command lines.
        codes: the exit codes it can end with, beside 0 and 2, which every command has.
        name: its name, if not the function's.
        endpoint: method of `Endpoints`, for a command that asks for one.
        json: False for a command without ``--json``, or with one of its own.
    """

    def declare(function: Command) -> Command:
        asked = endpoint_of(endpoint) if endpoint else None
        shared = {"as_json": JsonOption, "quiet": QuietOption} if json else {"quiet": QuietOption}
        run, text = _with_options(function, asked, shared)
        own_name, below = name or (asked.name if asked else None), epilog(*examples, codes=codes)
        setattr(function, _COMMAND, lambda app: app.command(own_name, help=text, epilog=below)(run))
        return function

    return declare


def add_commands(app: typer.Typer, module: Mapping[str, Any]) -> None:
    """Add what a module, given by its names, declares as commands, in the order of its text."""
    for value in module.values():
        if hasattr(value, _COMMAND):
            getattr(value, _COMMAND)(app)


def _with_options(function: Command, asked: Endpoint | None, shared: Mapping[str, Any]) -> tuple[Command, str]:
    """A command as typer takes it, and its help; `shared` are the options of every command."""
    about, _, arguments = inspect.cleandoc(function.__doc__ or "").partition("Args:\n")
    paragraphs = "\n\n".join(filter(None, [asked.description if asked else "", about.strip()])).split("\n\n")
    text = "\n\n".join(paragraph.replace("\n", " ") for paragraph in paragraphs).replace("[", "\\[")
    options = dict(_option(entry) for entry in re.split(r"^ {4}(?=\S)", arguments, flags=re.MULTILINE)[1:])
    for key, said in options.items():
        if asked and key in asked.signature.parameters:
            said["help"] = f"{asked.help_of(key)} {said['help']}"

    @functools.wraps(function)
    def run(**values: Any) -> int | None:
        output.quiet.set(values.pop("quiet"))
        output.as_json.set(values.pop("as_json", False))
        exits.options.set(frozenset(values))
        return function(**values)

    signature = inspect.signature(function, eval_str=True)
    parameters = [_with_help(parameter, options.get(key)) for key, parameter in signature.parameters.items()]
    for key, option in shared.items():
        parameters.append(inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option))
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run, text


def _option(entry: str) -> tuple[str, dict[str, Any]]:
    """A parameter, and what its line under ``Args`` says of its option, as attributes of typer's."""
    found = _OPTION.fullmatch(" ".join(entry.split()))
    assert found is not None, entry
    words = re.split(r",? ", found[2] or "")
    said: dict[str, Any] = {"help": found[3]}
    if flags := tuple(word for word in words if word.startswith("-")):
        said["param_decls"] = flags
    if words[-1] and not words[-1].startswith("-"):
        said["metavar"] = words[-1]
    return found[1], said


def _with_help(parameter: inspect.Parameter, said: dict[str, Any] | None) -> inspect.Parameter:
    """A parameter as typer takes it: with what its docstring says, or as it is where that says nothing."""
    if said is None:
        return parameter
    kind, infos = _hoisted(parameter.annotation)
    info = copy.copy(infos[0]) if infos else typer.Option()
    info.param_decls = (f"--{parameter.name.replace('_', '-')}",)
    info.show_default = parameter.default not in (None, parameter.empty)
    vars(info).update(said)
    return parameter.replace(annotation=Annotated[kind, info])


def _hoisted(annotation: Any) -> tuple[Any, list[Any]]:
    """A type, and what is annotated anywhere in it: typer looks at the outside alone."""
    if get_origin(annotation) is Annotated:
        return annotation.__origin__, list(annotation.__metadata__)
    parts = [_hoisted(part) for part in get_args(annotation)]
    infos = [info for _, found in parts for info in found]
    if not infos:
        return annotation, []
    kinds = [kind for kind, _ in parts]
    whole: Any = list[kinds[0]] if get_origin(annotation) is list else functools.reduce(operator.or_, kinds)  # type: ignore[valid-type]
    return whole, infos


def epilog(*examples: str, codes: tuple[int, ...] = ()) -> str:
    """The text under a help page: examples, then what each exit code of this command means; 0 and 2 are every command's."""
    shown = "\n".join(f"  {example}" for example in examples).replace("[", "\\[")
    return f"Examples:\n{shown}\n\nExit codes:\n" + "\n".join(
        f"  {code}  {MEANING[code]}" for code in sorted({DONE, USAGE, *codes})
    )
