"""The benchmark of late records: which cases it takes, and how it counts."""

from __future__ import annotations

from benchmarks.gap.late import Answered, is_tried, rows
from benchmarks.gap.plan import Case


def case(*slugs: str, kind: str = "single", strength: float = 0.5) -> Case:
    return Case(kind, slugs, (strength,) * len(slugs), 1, 0, "re35", "parquet", 20.0)


def test_effects_on_the_timing_are_no_cases_of_it() -> None:
    assert is_tried(case("stribeck"))
    assert is_tried(case(kind="none"))
    assert not is_tried(case("transport_delay"))
    assert not is_tried(case("stribeck", "gravity", kind="pair"))


def test_what_is_counted() -> None:
    found = [
        Answered(case("constant_bias"), ("asymmetric_coulomb",), 2e-3, (1.9e-3, 2.1e-3)),  # the same law
        Answered(case("stribeck"), ("stribeck", "gravity"), 2e-3, (2.1e-3, 2.2e-3)),
        Answered(case("stribeck"), ("gravity",), 2e-3, None),
        Answered(case("stribeck", strength=0.1), (), 2e-3, None),
        Answered(case(kind="none"), (), 1e-3, (0.9e-3, 1.1e-3)),
        Answered(case(kind="none"), ("viscous_friction",), 1e-3, None),
    ]
    shares = {name: without.partition("(")[2].partition(";")[0] for name, without, _ in rows(found)}
    assert shares == {
        "first name, strength ≥ 0.3": "2/3",
        "a wrong first name": "1/4",
        "wrong further names": "1/4",
        "nothing hidden: a name": "1/2",
        "lateness told": "3/6",
        "truth inside its 95 % interval": "2/3",
    }
    assert {with_coloured for _, _, with_coloured in rows(found)} == {"–"}
