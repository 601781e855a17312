"""The tutorials as notebooks: each is run from a clean kernel, and what it shows is looked for."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from .snippets import ROOT

FOLDER = ROOT / "docs/notebooks"
SHOWN = {
    "simulated-testbed": (r"Region F1", r"'monotone'|'decaying'", r"unstable +growing", r"servo\.rate_hz"),
    "first-run": (r"the sign is right", r"the model has 2 mN m", r"'running'", r"'off'"),
    "scope": (
        r"unstable",
        r"region D, at rest 20\.3 ticks",
        r"growing \| (over_speed|excursion) \|.*'hapticd clear'",
        r"'off'",
    ),
    "missing-effect": (r"Missing: viscous_friction", r"N m"),
}
FIGURES = {"simulated-testbed": 2, "first-run": 1, "missing-effect": 1, "scope": 2}


def test_every_tutorial_has_a_notebook_without_outputs() -> None:
    notebooks = {path.stem for path in FOLDER.glob("*.ipynb")}
    tutorials = {path.stem for path in (ROOT / "docs/tutorials").glob("*.md")}
    assert notebooks == set(SHOWN) == tutorials
    for name in notebooks:
        cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
        assert all(not cell.get("outputs") for cell in cells), name
        assert f"tutorials/{name}.md" in cells[0].source


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("name", sorted(SHOWN))
def test_notebook(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    for variable in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR", "XDG_DATA_HOME", "IPYTHONDIR"):
        monkeypatch.setenv(variable, str(tmp_path))
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=280, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    text = "\n".join(shown(output) for output in outputs)
    for pattern in SHOWN[name]:
        assert re.search(pattern, text), f"{pattern} is not in\n{text}"
    assert sum("image/png" in output.get("data", {}) for output in outputs) == FIGURES[name]
    assert not any(output.get("name") == "stderr" for output in outputs), text


def shown(output: Any) -> str:
    return str(output.get("text") or output.get("data", {}).get("text/plain", ""))
