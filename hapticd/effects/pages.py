"""The documentation pages made from the catalogue.

``python -m hapticd.effects.pages docs/effects`` writes a page for each effect of hapticd, and the table in its README;
``python -m hapticd.effects.pages FOLDER SLUG…`` only the pages of those effects, which may be of other packages.
"""

from __future__ import annotations

import argparse
import re
import textwrap
from pathlib import Path

from hapticd.effects.catalogue import BROKEN, CATALOGUE, OWN_SLUGS
from hapticd.effects.spec import Effect, Parameter

_WIDTH = 120
_TABLE = re.compile(r"^\| effect \|.*?(?=\n\n)", re.MULTILINE | re.DOTALL)
_HEAD = "| effect | acts on | law | parameters | near |\n|---|---|---|---|---|"


def page(effect: Effect) -> str:
    """The text of an effect's page."""
    notes = effect.notes
    others = [f"Identical in law: {_links(effect.equivalent_to)}."] if effect.equivalent_to else []
    if effect.near:
        others.insert(0, f"{_links(effect.near)}.")
    experiment = f"What shows it: {notes.shown_by}" if notes.shown_by else ""
    source = "python -m hapticd.effects.pages"
    sections = {
        "Law": "\n\n".join([_law(effect.law), _parameters(effect), _example(effect)]),
        "In data": _paragraphs(effect.where_it_shows),
        "Confused with": _paragraphs(" ".join(others), notes.told_apart, experiment),
        "In theory": _paragraphs(_in_theory(effect)),
        "How it is simulated": _paragraphs(notes.simulated),
        "Source": _paragraphs(effect.source),
    }
    parts = [f"# {effect.slug}", f"<!-- Made by {source} from the effect's file; edit that. -->", effect.summary]
    parts += [f"## {title}\n\n{text}" for title, text in sections.items() if text]
    return "\n\n".join(parts) + "\n"


def table() -> str:
    """The README's table of hapticd's effects."""
    return "\n".join([_HEAD, *(_table_row(CATALOGUE[slug]) for slug in OWN_SLUGS)])


def with_table(readme: str) -> str:
    """The README with its table updated."""
    return _TABLE.sub(lambda match: table(), readme)


def _table_row(effect: Effect) -> str:
    parameters = ", ".join(f"`{parameter.name}`" for parameter in effect.parameters)
    near = ", ".join([*(f"{slug} (identical)" for slug in effect.equivalent_to), *effect.near]) or "–"
    cells = [f"[{effect.slug}]({effect.slug}.md)", effect.acts_on, _cell(effect.law), parameters, near]
    return f"| {' | '.join(cells)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _links(slugs: tuple[str, ...]) -> str:
    return ", ".join(f"[{slug}]({slug}.md)" for slug in slugs)


def _paragraphs(*texts: str) -> str:
    return "\n\n".join(textwrap.fill(text, _WIDTH, break_on_hyphens=False) for text in texts if text.strip())


def _law(law: str) -> str:
    return textwrap.indent(textwrap.fill(law, _WIDTH - 4, break_on_hyphens=False), "    ")


def _parameters(effect: Effect) -> str:
    rows = "\n".join(_parameter_row(parameter) for parameter in effect.parameters)
    return f"| parameter | unit | linear device | off | range |\n|---|---|---|---|---|\n{rows}"


def _parameter_row(parameter: Parameter) -> str:
    name = f"`{parameter.name}`"
    if parameter.length > 1:
        name += f" (list of up to {parameter.length})"
    if not parameter.required:
        name += ", optional"
    off = "∞" if parameter.neutral == float("inf") else _number(parameter.neutral)
    bounds = f"{_number(parameter.lower)} … {_number(parameter.upper)}"
    return f"| {name} | {parameter.unit or 'number'} | {parameter.unit_linear or 'number'} | {off} | {bounds} |"


def _number(value: float) -> str:
    return f"{value:.15g}"


def _example(effect: Effect) -> str:
    return f"```yaml\nplant:\n  effects:\n    - {{name: {effect.slug}, {effect.example}}}\n```"


def _in_theory(effect: Effect) -> str:
    if effect.in_loop is None:
        return "The stability criterion leaves it out, and `hapticd check` says so; `hapticd simulate` includes it."
    return f"The stability criterion counts it. {effect.notes.in_theory}"


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(prog="python -m hapticd.effects.pages", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="where the pages go")
    parser.add_argument("slug", nargs="*", help="effects; default: all that hapticd itself has, and the table")
    arguments = parser.parse_args()
    for slug in arguments.slug:
        if slug not in CATALOGUE:
            parser.error(f"effect {slug} cannot be used: {BROKEN.get(slug, 'there is none of that name')}")
    try:
        arguments.folder.mkdir(parents=True, exist_ok=True)
        for slug in arguments.slug or OWN_SLUGS:
            (arguments.folder / f"{slug}.md").write_text(page(CATALOGUE[slug]), encoding="utf-8")
        readme = arguments.folder / "README.md"
        if not arguments.slug and readme.exists():
            readme.write_text(with_table(readme.read_text(encoding="utf-8")), encoding="utf-8")
    except OSError as error:
        parser.error(f"{error.filename or arguments.folder}: {error.strerror or error}")


if __name__ == "__main__":
    main()
