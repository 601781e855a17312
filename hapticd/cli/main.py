"""Entry point: puts the commands together, and ends every one of them with the right exit code and no traceback."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from hapticd.cli import exits, output
from hapticd.cli.command import add_commands, epilog

HELP = """Stable haptic rendering on one degree of freedom, in real time.

'hapticd run' is the daemon: it reads the encoder, renders a virtual spring and
drives the amplifier at a fixed rate. The other commands talk to it over its
Unix socket, or work without it. Each has its own --help with units, examples
and exit codes.
"""

EPILOG = epilog(
    "hapticd run                         the simulated testbed, in real time",
    "hapticd status --watch              what it does, from another terminal",
    "hapticd release --deflection 20.3   the paper's release experiment",
    "hapticd set spring.stiffness=0.02   change the spring under the hand",
    codes=tuple(exits.MEANING),
)

MODULES = (
    "run", "scope", "status", "state", "experiments", "record", "noting", "verify", "recover", "runs", "plot",
    "export", "importing", "model", "metrics", "check", "simulate", "energy", "map", "zwidth", "reproduce",
    "identify", "gap", "inspecting", "help", "hil", "commission", "init", "config", "drivers", "doctor", "latency",
)  # fmt: skip
"""Modules of this package that declare commands, in the order of the help."""
GROUPS = {
    "record": (
        "Start and stop recordings.",
        ("hapticd record start", "hapticd record stop"),
        (exits.NO, exits.UNREACHABLE),
    ),
    "model": ("Take the model elsewhere.", ("hapticd model export gap/model.yaml --to mjcf",), ()),
    "config": ("Look at the config.", ("hapticd config show",), ()),
}
"""Modules whose commands stand below one of the module's name: its help, examples and exit codes."""


class PipeGroup(TyperGroup):
    """A group whose commands end quietly when the reader of their output has gone, as ``head`` does."""

    def invoke(self, ctx: Any) -> int:
        """Run the command and return its exit code."""
        try:
            code = super().invoke(ctx)
            sys.stdout.flush()
        except BrokenPipeError:
            return _reader_gone()
        return code if isinstance(code, int) else exits.DONE


def build_app() -> typer.Typer:
    """The whole command line."""
    app = typer.Typer(
        name="hapticd",
        cls=PipeGroup,
        help=HELP,
        epilog=EPILOG,
        no_args_is_help=True,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for name in MODULES:
        module, group = importlib.import_module(f"hapticd.cli.{name}"), app
        if name in GROUPS:
            text, examples, codes = GROUPS[name]
            group = typer.Typer(help=text, no_args_is_help=True, rich_markup_mode="rich")
            app.add_typer(group, name=name, epilog=epilog(*examples, codes=codes))
        add_commands(group, vars(module))
    return app


def _reader_gone() -> int:
    """Throw away what is still buffered for nobody, or the interpreter would complain about it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return exits.BROKEN_PIPE


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"hapticd {version('hapticd')}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options that stand before the command."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: words of the command line, without the program's name; None takes them from the process.

    Returns:
        The exit code.
    """
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    finally:
        output.last.get()()


def _run(line: list[str]) -> int:
    command = typer.main.get_command(build_app())
    try:
        code = command.main(line, prog_name="hapticd", standalone_mode=False)
    except typer.TyperException as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # it has printed the help by itself
            return exits.USAGE
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else "hapticd"
        failure = exits.Failure(exits.USAGE, "usage", f"{error.format_message()} (see '{path} --help')")
    except Exception as error:
        known = exits.explain(error)
        if known is None:
            traceback.print_exc()
        failure = known or exits.Failure(
            exits.NO, "internal", f"this is a bug in hapticd: {type(error).__name__}: {error}"
        )
    else:
        if code == exits.INTERRUPTED:
            output.note("interrupted")
        return code if isinstance(code, int) else exits.DONE
    output.warn(failure.message)
    if "--json" in line:
        try:
            print(output.to_json(failure.document), flush=True)
        except BrokenPipeError:
            return _reader_gone()
    return failure.exit_code
