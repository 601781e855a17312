"""The benchmark of late records: which cases it takes, and how it counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.gap.late import Answered, is_filtered, is_tried, recorded, rows
from benchmarks.gap.plan import Case
from hapticd.gap.recording import Recording


def case(*slugs: str, kind: str = "single", strength: float = 0.5, number: int = 0) -> Case:
    return Case(kind, slugs, (strength,) * len(slugs), 1, number, "re35", "parquet", 20.0)


def test_effects_on_the_timing_are_no_cases_of_it() -> None:
    assert is_tried(case("stribeck"))
    assert is_tried(case(kind="none"))
    assert not is_tried(case("transport_delay"))
    assert not is_tried(case("stribeck", "gravity", kind="pair"))


def test_behind_a_filter_effects_on_the_input_are_none_either() -> None:
    assert not is_filtered(case("current_saturation"))
    assert is_tried(case("current_saturation"))
    assert is_filtered(case("current_saturation", number=1))
    assert not is_tried(case("current_saturation", number=1))


def test_a_record_is_late_or_filtered() -> None:
    time_s = 1e-3 * np.arange(2000)
    actual = np.sin(3.0 * time_s)
    recording = Recording("made", time_s, actual, 1e-3, actual, None, 1e-3, False)
    late_s, late = recorded(case(kind="none"), recording)
    rows_late = round(late_s / 1e-3)
    assert 1 <= rows_late <= 5
    assert np.array_equal(late[rows_late:], actual[:-rows_late])
    filter_s, filtered = recorded(case(kind="none", number=1), recording)
    assert 5e-3 <= filter_s <= 0.1
    assert filtered[1000:-1] + filter_s * np.diff(filtered[1000:]) / 1e-3 == pytest.approx(actual[1000:-1], abs=2e-3)


def test_what_is_counted() -> None:
    found = [
        Answered(case("constant_bias"), ("asymmetric_coulomb",), False, 2e-3, (1.9e-3, 2.1e-3)),  # the same law
        Answered(case("stribeck"), ("stribeck", "gravity"), False, 2e-3, (2.1e-3, 2.2e-3)),
        Answered(case("stribeck"), ("gravity",), False, 2e-3, None),
        Answered(case("stribeck", strength=0.1), (), False, 2e-3, None),
        Answered(case(kind="none"), (), False, 1e-3, (0.9e-3, 1.1e-3)),
        Answered(case(kind="none"), ("viscous_friction",), False, 1e-3, None),
        Answered(case(kind="none"), (), True, 0.05, (0.049, 0.051)),
        Answered(case(kind="none"), (), True, 0.05, None),
    ]
    shares = {name: without.partition("(")[2].partition(";")[0] for name, without, _ in rows(found)}
    assert shares == {
        "first name, strength ≥ 0.3": "2/3",
        "a wrong first name": "1/4",
        "wrong further names": "1/4",
        "nothing hidden: a name": "1/4",
        "lateness told": "3/6",
        "filter told": "1/2",
        "truth inside its 95 % interval": "3/4",
    }
    assert {with_coloured for _, _, with_coloured in rows(found)} == {"–"}
