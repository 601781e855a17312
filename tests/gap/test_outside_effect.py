"""An effect that another package brings is found like any other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.effects.test_from_outside import environment, run  # noqa: F401  the fixture

from .outside_effect import PLACE, WIDTH, A


@pytest.mark.timeout(900)  # where nothing is compiled yet
def test_a_hidden_effect_from_outside_is_named(environment: dict[str, str], tmp_path: Path) -> None:  # noqa: F811
    done = run(environment, "-m", "tests.gap.outside_effect")
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["known"]
    assert found["effects"][0] == "magnetic_detent", found["statement"]
    assert found["values"]["a"] == pytest.approx(A, rel=0.05)
    assert found["values"]["theta_0"] == pytest.approx(PLACE, abs=0.05)
    assert found["values"]["w"] == pytest.approx(WIDTH, rel=0.05)
    assert found["after"] < 0.3 * found["before"]
