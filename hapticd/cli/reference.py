"""Writes the reference pages that are made from the program itself: ``python -m hapticd.cli.reference docs/reference``.

``cli.md`` is every command's help, ``openapi.json`` the control API's document. Tests keep both current.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from hapticd.cli.main import build_app

INTRODUCTION = """# Command line

Made from the program by `python -m hapticd.cli.reference docs/reference`; do not edit.

Every command that reports takes `--json`: exactly one JSON document on stdout, everything else on stderr. An error is
then a document too, `{"error": {"code": …, "message": …}}`, with the same exit code. Long work shows a progress bar on a
terminal and none in a pipe. The daemon is found by `--socket`, else the variable `HAPTICD_SOCKET`, else `api.socket` of
the built-in config, else, where nothing is there, the service's `/run/hapticd/hapticd.sock`.
"""


def commands(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    """A command and everything below it, with the words that call it."""
    yield path, command
    for name, child in getattr(command, "commands", {}).items():
        yield from commands(child, f"{path} {name}")


def command_line() -> str:
    """The text of ``cli.md``."""
    root = typer.main.get_command(build_app())
    return "\n".join([INTRODUCTION, *(_section(path, command) for path, command in commands(root, "hapticd"))])


def _section(path: str, command: Any) -> str:
    context = typer.Context(command, info_name=path)
    usage = " ".join([path, *command.collect_usage_pieces(context)])
    parts = [f"## {path}", f"```\n{usage}\n```", plain(command.help)]
    rows = [f"| `{_cell(names)}` | {_cell(meaning)} |" for names, meaning in parameters(command, context)]
    if rows:
        parts.append("\n".join(["| argument or option | meaning |", "|---|---|", *rows]))
    if children := getattr(command, "commands", {}):
        listed = [f"- [`{path} {name}`](#{f'{path} {name}'.replace(' ', '-')})" for name in children]
        parts.append("\n".join(listed))
    parts.append(f"```\n{plain(command.epilog)}\n```")
    return "\n\n".join(parts) + "\n"


def parameters(command: Any, context: typer.Context) -> Iterator[tuple[str, str]]:
    """Arguments and options of a command: how each is written, and what it means."""
    for parameter in command.params:
        if parameter.name == "help":
            continue
        names = ", ".join(parameter.opts) if parameter.param_type_name == "option" else parameter.metavar
        if parameter.param_type_name == "option" and not getattr(parameter, "is_flag", False):
            names += f" {parameter.metavar or parameter.display_type(context)}"
        meaning = plain(parameter.help)
        if parameter.required:
            meaning += " Required."
        if parameter.envvar:
            meaning += f" Variable: {parameter.envvar}."
        if parameter.show_default and parameter.default not in (None, False):
            meaning += f" Default: {parameter.default}."
        yield names, meaning


def _cell(text: str) -> str:
    return text.replace("|", chr(92) + "|")


def plain(text: str | None) -> str:
    """A help text without its mark-up."""
    return (text or "").replace("\\[", "[").strip()


def main(folder: Path) -> None:
    """Write both pages into ``folder``."""
    from hapticd.service.api import openapi_document

    (folder / "cli.md").write_text(command_line(), encoding="utf-8")
    (folder / "openapi.json").write_text(
        json.dumps(openapi_document(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
