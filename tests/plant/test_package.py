"""The package as its users meet it: names on first use, the page that explains it, nothing compiled unasked."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import hapticd.plant

PAGE = Path(__file__).parents[2] / "docs/explanation/exact-plant.md"


@pytest.mark.parametrize("name", hapticd.plant.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    assert getattr(hapticd.plant, name).__doc__


def test_other_names_are_refused_as_usual() -> None:
    with pytest.raises(AttributeError, match=r"^module 'hapticd\.plant' has no attribute 'Motor'$"):
        hapticd.plant.Motor  # noqa: B018


def test_the_config_and_the_bare_package_load_nothing_compiled() -> None:
    script = (
        "import sys, hapticd.config; print('hapticd.plant' in sys.modules);"
        "import hapticd.plant; print('numba' in sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "False"]


def test_the_example_on_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    exec(compile(example, str(PAGE), "exec"), {})
    counts, position, velocity = map(float, capsys.readouterr().out.split())
    assert counts > 0
    assert position > 0.0
    assert velocity == 0.0
