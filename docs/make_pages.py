"""Writes the reference pages that are made from the program itself: ``python -m docs.make_pages``.

``cli.md`` is every command's help, ``openapi.json`` the control API's document, ``config.md`` the schema's. Tests keep them
current.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import typer

from docs.config_page import reference_page
from hapticd.cli.main import build_app
from hapticd.cli.man import commands, parameters, plain
from hapticd.service.api import openapi_document

INTRODUCTION = """# Command line

Made from the program by `python -m docs.make_pages`; do not edit.

Every command that reports takes `--json`: exactly one JSON document on stdout, everything else on stderr. An error is
then a document too, `{"error": {"code": …, "message": …}}`, with the same exit code. Long work shows a progress bar on a
terminal and none in a pipe. The daemon is found by `--socket`, else the variable `HAPTICD_SOCKET`, else `api.socket` of
the built-in config, else, where nothing is there, the service's `/run/hapticd/hapticd.sock`.
"""


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


def _cell(text: str) -> str:
    return text.replace("|", chr(92) + "|")


def main() -> None:
    """Write every page."""
    folder = Path(__file__).parent / "reference"
    document = json.dumps(openapi_document(), indent=2, ensure_ascii=False) + "\n"
    for name, text in (("cli.md", command_line()), ("openapi.json", document), ("config.md", reference_page())):
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
