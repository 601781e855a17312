"""``hapticd help FAULT``: what a fault means and what to do, without a browser and without the sources."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError


def complete_fault(incomplete: str) -> list[str]:
    """Codes of faults that a word may be meant to be."""
    from hapticd.fault_pages import fault_pages

    return [code for code in fault_pages() if code.startswith(incomplete)]


FaultArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="[FAULT]",
        show_default=False,
        autocompletion=complete_fault,
        help="Code of a fault, as 'hapticd status' and the log name it: over_speed, driver_lost, … Default: list them all.",
    ),
]


@command("hapticd help over_speed", "hapticd help", "hapticd help release", name="help")
def help_fault(fault: FaultArgument = None) -> int:
    """Say what a fault means: what hapticd did, likely causes with a check for each, how to clear it, its config keys.

    Help about a command is its --help, and that is what this shows of one.
    """
    from hapticd.fault_pages import fault_page, fault_pages

    pages = fault_pages()
    if fault is None:
        summaries = {code: _summary(page.read_text(encoding="utf-8")) for code, page in pages.items()}
        text = "\n".join(f"{code:20}{summary}" for code, summary in summaries.items())
        output.emit({"faults": summaries}, f"{text}\n\nhapticd help FAULT says more; hapticd --help is about commands")
        return exits.DONE
    page = fault_page(fault)
    if page is None and _is_command(fault):
        from hapticd.cli.main import main

        return main([*fault.split(), "--help"])
    if page is None:
        from hapticd.config.nearest import nearest_name

        nearest = nearest_name(fault, pages)
        hint = f"; did you mean {nearest}?" if nearest else f"; faults: {', '.join(pages)}"
        raise UsageError(f"{fault} is no fault{hint}\nhelp about a command: hapticd {fault} --help")
    if output.as_json.get() or not sys.stdout.isatty():
        output.emit({"fault": fault, "page": page}, page.rstrip())
        return exits.DONE
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(page, hyperlinks=False))
    return exits.DONE


def _is_command(words: str) -> bool:
    from hapticd.cli.main import build_app

    found: Any = typer.main.get_command(build_app())
    for word in words.split():
        found = getattr(found, "commands", {}).get(word)
    return found is not None


def _summary(page: str) -> str:
    """The first sentence of a page."""
    paragraph = " ".join(page.split("\n\n")[1].split())
    return f"{paragraph.partition('. ')[0].rstrip('.')}"
