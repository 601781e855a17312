"""Manual pages from the program's own help: ``python -m hapticd.cli.man DIR`` writes hapticd.1 and one page a command."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from hapticd.cli.main import build_app


def commands(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    """A command and everything below it, with the words that call it."""
    yield path, command
    for name, child in getattr(command, "commands", {}).items():
        yield from commands(child, f"{path} {name}")


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


def plain(text: str | None) -> str:
    """A help text without its mark-up."""
    return (text or "").replace("\\[", "[").strip()


def manual(path: str, command: Any) -> str:
    """One page in man(7) macros; ``path`` is the words that call the command."""
    context = typer.Context(command, info_name=path)
    usage = " ".join([path, *command.collect_usage_pieces(context)])
    first, _, rest = plain(command.help).partition("\n")
    lines = [
        f'.TH "{path.replace(" ", "-").upper()}" 1 "" hapticd "hapticd manual"',
        ".SH NAME",
        f"{_escape(path.replace(' ', '-'))} \\- {_escape(first.rstrip('.'))}",
        ".SH SYNOPSIS",
        f".B {_escape(usage)}",
    ]
    if rest.strip():
        lines += [".SH DESCRIPTION", *_paragraphs(rest)]
    options = list(parameters(command, context))
    if options:
        lines.append(".SH OPTIONS")
        for names, meaning in options:
            lines += [".TP", f".B {_escape(names)}", _escape(meaning)]
    if children := getattr(command, "commands", {}):
        lines.append(".SH COMMANDS")
        for name, child in children.items():
            summary = plain(child.help).partition("\n")[0]
            lines += [".TP", f".BR {_escape(f'{path} {name}'.replace(' ', '-'))} (1)", _escape(summary)]
    if command.epilog:
        lines += [".SH EXAMPLES AND EXIT CODES", ".nf", *map(_escape, plain(command.epilog).splitlines()), ".fi"]
    return "\n".join(lines) + "\n"


def _paragraphs(text: str) -> list[str]:
    lines: list[str] = []
    for paragraph in text.strip().split("\n\n"):
        lines += [".PP", *(_escape(line.strip()) for line in paragraph.splitlines())]
    return lines


def _escape(text: str) -> str:
    """Backslashes and hyphens as characters, and no line that begins a macro."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


def main(folder: Path) -> None:
    """Write every page."""
    folder.mkdir(parents=True, exist_ok=True)
    for path, command in commands(typer.main.get_command(build_app()), "hapticd"):
        (folder / f"{path.replace(' ', '-')}.1").write_text(manual(path, command), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
