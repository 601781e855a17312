"""Creates the items, and writes their files and the page: all of them, or none."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import pydantic_core

from hapticd.figures.style import save, style
from hapticd.reproduce import fig_03, fig_04, fig_05, fig_08, fig_09, fig_11, fig_12, maps, table_1, table_2
from hapticd.reproduce.items import Item, Progress
from hapticd.reproduce.page import page

#: Name → its builder and its weight in the progress, in the order of the paper. A builder takes whether maps are coarse and
#: horizons short (which does not change the comparisons), and a callback for the progress.
BUILDERS: Final[dict[str, tuple[Callable[[bool, Progress], Item], float]]] = {
    "table1": (table_1.build, 0.1),
    "table2": (table_2.build, 0.1),
    "fig3": (fig_03.build, 1.0),
    "fig4": (fig_04.build, 1.0),
    "fig5": (fig_05.build, 1.0),
    "fig6": (maps.fig_6, 4.0),
    "fig7": (maps.fig_7, 4.0),
    "fig8": (fig_08.build, 2.0),
    "fig9": (fig_09.build, 1.0),
    "fig11": (fig_11.build, 1.0),
    "fig12": (fig_12.build, 2.0),
}
PAGE: Final = "index.html"
NUMBERS: Final = "numbers.json"
# share of the progress for the builder; the rest is for writing its figure
_MAKING: Final = 0.6


def names_of_files(only: Sequence[str] = ()) -> list[str]:
    """Names of all files that `reproduce` writes for these items; for all items if `only` is empty."""
    figures = [name for name in BUILDERS if name.startswith("fig") and (not only or name in only)]
    return [PAGE, NUMBERS, *(f"{name}.{kind}" for name in figures for kind in ("png", "svg"))]


def reproduce(
    folder: Path, *, quick: bool = False, only: Sequence[str] = (), progress: Progress = lambda fraction: None
) -> dict[str, Any]:
    """Reproduce the paper into a folder, which is created if missing.

    Files are written to a temporary folder and moved when all are complete, the page last; an interruption before that does
    not change the folder.

    Args:
        folder: of the output.
        quick: coarser maps and shorter horizons.
        only: names from `BUILDERS`; all if empty.
        progress: called with the fraction done.

    Returns:
        The document of ``numbers.json``.

    Raises:
        ValueError: a name that is not in `BUILDERS`.
        OSError: the folder cannot be written.
    """
    if unknown := set(only) - set(BUILDERS):
        raise ValueError(f"no such table or figure: {', '.join(sorted(unknown))}; there are {', '.join(BUILDERS)}")
    names = [name for name in BUILDERS if not only or name in only]
    # on the same file system, so that a file is moved in one step
    near = folder if folder.is_dir() else folder.absolute().parent
    near.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=".reproduce.", dir=near))
    try:
        with style():
            items = _build(names, quick, work, progress)
        document = _document(items, quick)
        (work / NUMBERS).write_text(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        (work / PAGE).write_text(page(items, work, version("hapticd"), quick))
        folder.mkdir(exist_ok=True)
        for path in sorted(work.iterdir(), key=lambda path: path.name == PAGE):
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return document


def _build(names: Sequence[str], quick: bool, folder: Path, progress: Progress) -> list[Item]:
    total = sum(BUILDERS[name][1] for name in names)
    done, items = 0.0, []
    for name in names:
        builder, weight = BUILDERS[name]
        item = builder(quick, partial(_part, progress, done / total, _MAKING * weight / total))
        if item.figure is not None:
            save(item.figure, folder / name)
        done += weight
        progress(done / total)
        items.append(item)
    return items


def _part(progress: Progress, start: float, size: float, fraction: float) -> None:
    progress(start + size * fraction)


def _document(items: Sequence[Item], quick: bool) -> dict[str, Any]:
    comparisons = [(item.name, comparison) for item in items for comparison in item.comparisons]
    document = {
        "hapticd": version("hapticd"),
        "quick": quick,
        "comparisons": len(comparisons),
        "agree": sum(comparison.agrees for _, comparison in comparisons),
        "differ": [{"item": name, **comparison.document} for name, comparison in comparisons if not comparison.agrees],
        "items": {item.name: item.document for item in items},
    }
    found: dict[str, Any] = pydantic_core.to_jsonable_python(
        document, inf_nan_mode="null", fallback=lambda numbers: numbers.tolist()
    )
    return found
