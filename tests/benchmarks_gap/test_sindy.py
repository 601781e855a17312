"""The peer gets a fair chance: terms of its own library are found where they stand out."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.gap import cases, sindy
from benchmarks.gap.generate import generate
from benchmarks.gap.hidden import Effect

pytest.importorskip("pysindy", reason="needs the peer: pip install '.[bench]'")


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "constant_bias", "tau_0": 6e-4},
        {"name": "coulomb_friction", "r": 0.4},
        {"name": "torque_ripple", "orders": [7], "amplitudes": [8e-4], "phases": [0.3]},
    ],
    ids=lambda effect: effect["name"],
)
def test_it_names_a_large_effect_of_its_library_first(effect: Effect, tmp_path: Path) -> None:
    cases.write_files(tmp_path, cases.case_files(generate([effect], 3, 10.0), "parquet"))
    found = sindy.identify(tmp_path)
    assert found["verdict"] == "effect_found"
    assert found["effects"][0] == effect["name"], found
