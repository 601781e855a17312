"""Writes the reference pages that are made from the program itself: ``python -m docs.make_pages``.

``cli.md`` is the commands in a line each (the site has their help below), ``openapi.json`` the control API's document,
``config.md`` the schema's, ``model-formats.md`` what each format of ``hapticd model export`` says of each effect. Tests keep
them current.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import typer

from docs.config_page import reference_page
from hapticd.cli.main import build_app
from hapticd.cli.man import commands, parameters, plain
from hapticd.export.table import markdown
from hapticd.service.api import openapi_document

INTRODUCTION = """# Command line

Made from the program by `python -m docs.make_pages`; do not edit. Arguments, options and examples of a command are in
`hapticd COMMAND --help`, in its manual page (`man hapticd-gap`), and below this list on the site that `make site` makes.

Every command that reports takes `--json`: exactly one JSON document on stdout, everything else on stderr. An error is
then a document too, `{"error": {"code": …, "message": …}}`, with the same exit code. Long work shows a progress bar on a
terminal and none in a pipe.
"""
SECTIONS = "<!-- On the site the commands follow here, each with its options: docs/site_hooks.py. -->"
"""Where the site's build puts `command_sections` on the page."""
COMMON_FROM = 3
"""Commands that take an option with the same meaning: from here on it is described once."""

_Row = tuple[str, str]


def command_line() -> str:
    """The text of ``cli.md``: exit codes, and each command in a line."""
    found = _commands()
    listed = "\n".join(f"- `{path}`: {plain(command.help).splitlines()[0]}" for path, command in found[1:])
    parts = [
        INTRODUCTION,
        f"## Exit codes\n\n```\n{_exit_codes(found[0][1])}\n```\n",
        f"## Commands\n\n{listed}\n",
        f"{SECTIONS}\n",
    ]
    return "\n".join(parts)


def command_sections() -> str:
    """Every command with its usage, help, options and exit codes: what the site has below the list."""
    found = _commands()
    common = _common(found)
    head = f"## Common options\n\nA command names those of them that it takes.\n\n{_table(list(common))}\n"
    return "\n".join([head, *(_section(path, command, _rows(path, command), common) for path, command in found)])


def _commands() -> list[tuple[str, Any]]:
    return list(commands(typer.main.get_command(build_app()), "hapticd"))


def _rows(path: str, command: Any) -> list[_Row]:
    return list(parameters(command, typer.Context(command, info_name=path)))


def _common(found: list[tuple[str, Any]]) -> dict[_Row, str]:
    """The options of several commands, and how a command's section names them."""
    counted = Counter(row for path, command in found for row in _rows(path, command))
    return {row: f"`{_cell(row[0])}`" for row, number in counted.items() if number >= COMMON_FROM}


def _section(path: str, command: Any, rows: list[_Row], common: dict[_Row, str]) -> str:
    usage = " ".join([path, *command.collect_usage_pieces(typer.Context(command, info_name=path))])
    examples = plain(command.epilog).partition("Exit codes:")[0].partition("Examples:")[2].strip("\n").rstrip()
    parts = [f"## {path}", f"```\n{usage}\n\n{examples}\n```", plain(command.help)]
    if own := [row for row in rows if row not in common]:
        parts.append(_table(own))
    if shared := [common[row] for row in rows if row in common]:
        parts.append(f"Common: {', '.join(shared)}.")
    if children := getattr(command, "commands", {}):
        links = (f"[{name}](#{f'{path} {name}'.replace(' ', '-')})" for name in children)
        parts.append(f"Commands: {', '.join(links)}.")
    codes = [line.split()[0] for line in _exit_codes(command).splitlines()]
    parts.append(f"Exit codes: {', '.join(codes)}.")
    return "\n\n".join(parts) + "\n"


def _table(rows: list[_Row]) -> str:
    lines = (f"| `{_cell(names)}` | {_cell(meaning)} |" for names, meaning in rows)
    return "\n".join(["| argument or option | meaning |", "|---|---|", *lines])


def _exit_codes(command: Any) -> str:
    return plain(command.epilog).partition("Exit codes:")[2].strip("\n")


def _cell(text: str) -> str:
    return text.replace("|", chr(92) + "|")


FORMATS = """# What each format says of each effect

Made from `hapticd/export/table.py` by `python -m docs.make_pages`; do not edit. [How to take the model with
you](../how-to/take-the-model-with-you.md).

**exact**: the law of [the catalogue](../effects/README.md); what differs is the solver's step. **approximated**: another law
that comes near. **refused**: left out, and said so.

"""


def model_formats() -> str:
    """The text of ``model-formats.md``."""
    return FORMATS + markdown()


def main() -> None:
    """Write every page."""
    folder = Path(__file__).parent / "reference"
    document = json.dumps(openapi_document(), indent=2, ensure_ascii=False) + "\n"
    pages = {
        "cli.md": command_line(),
        "openapi.json": document,
        "config.md": reference_page(),
        "model-formats.md": model_formats(),
    }
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
