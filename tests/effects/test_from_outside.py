"""Effects that another package brings by entry points: installed for a process of its own, in which hapticd has them."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "third_party_effect"
GROUP = "hapticd.effects"
OTHERS = """
drying_grease = tests.effects.drying_grease:EFFECT
absent = no_such_module:EFFECT
number = tests.effects.drying_grease:NOT_AN_EFFECT
misnamed = tests.effects.drying_grease:EFFECT
nameless_relation = tests.effects.drying_grease:NAMELESS_RELATION
lawless = tests.effects.drying_grease:LAWLESS
misplaced = tests.effects.drying_grease:MISPLACED
short = tests.effects.drying_grease:SHORT
stribeck = tests.effects.drying_grease:CLASH
lengthy = tests.effects.drying_grease:LENGTHY
uncompilable = tests.effects.drying_grease:UNCOMPILABLE
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """What ``pip install`` of the example's folder, and of a package with the rest, does."""
    points = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"][GROUP]
    example = "\n".join(f"{name} = {value}" for name, value in points.items())
    folder = tmp_path / "site" / "outside_effects-1.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: outside-effects\nVersion: 1\n")
    (folder / "entry_points.txt").write_text(f"[{GROUP}]\n{example}\n{OTHERS}")
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (folder.parent, EXAMPLE, ROOT)))}


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=1200, check=False
    )


@pytest.mark.timeout(1300)  # where nothing is compiled yet
def test_an_installed_effect_works_everywhere(environment: dict[str, str]) -> None:
    same_as_before = "tests/plant/effects/test_properties.py::test_without_effects_it_is_the_exact_plant_to_the_bit"
    done = run(
        environment, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/effects/installed.py", same_as_before
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_its_page_is_written_on_request(environment: dict[str, str], tmp_path: Path) -> None:
    command = ("-m", "hapticd.effects.pages", str(tmp_path))
    assert run(environment, *command, "magnetic_detent").returncode == 0
    assert [path.name for path in tmp_path.glob("*.md")] == ["magnetic_detent.md"]
    refused = run(environment, *command, "absent")
    assert refused.returncode == 2
    assert "entry point absent = no_such_module:EFFECT of outside-effects: ModuleNotFoundError" in refused.stderr


def test_its_file_can_be_imported_first(environment: dict[str, str]) -> None:
    """The catalogue loads the file by its entry point: neither may wait for the other."""
    code = (
        "import magnetic_detent; from hapticd.effects.catalogue import CATALOGUE as c; print(c['magnetic_detent'].slug)"
    )
    assert run(environment, "-c", code).stdout == "magnetic_detent\n"


def test_the_catalogue_needs_no_compiler(environment: dict[str, str]) -> None:
    code = "import sys, hapticd.config; print('numba' in sys.modules, 'numpy' in sys.modules)"
    assert run(environment, "-c", code).stdout == "False False\n"
