"""What ``check`` says: verdict, advice that does what it promises, warnings, words a student understands."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from hapticd.config import Config, apply_settings, load_config
from hapticd.config.units import deflection_ticks
from hapticd.stability.advice import Change, Unit, advise
from hapticd.stability.assessment import Assessment, Verdict, assess
from hapticd.stability.devices import TABLE_II
from hapticd.stability.explore import GUARD, REMEDY
from hapticd.stability.figures.check import check_figure
from hapticd.stability.regions import MEANING
from hapticd.stability.report import HEADLINES, WHY, advice_text, number, report
from hapticd.stability.tuning import Start, margin, stiffness_max_dissipating

IDEAL = {"amplifier.bandwidth_hz": 0, "amplifier.dac_bits": 0}
FIG8: dict[str, tuple[dict[str, Any], float, str]] = {
    "a": ({"encoder.decimation": 217}, 20.3, "A"),
    "b": ({"encoder.decimation": 2172}, 3.3, "B"),
    "c": ({"servo.rate_hz": 100, "encoder.decimation": 217}, 2.3, "E"),
    "d": ({"servo.rate_hz": 100, "encoder.decimation": 217}, 10.3, "D"),
}


def make(settings_: dict[str, Any], base: str | None = None) -> Config:
    return apply_settings(load_config(base), settings_)


def fig8(case: str) -> Assessment:
    changed, deflection, _ = FIG8[case]
    return assess(make({**IDEAL, **changed}), deflection=deflection)


def after(found: Assessment, change: Change) -> Assessment:
    """What holds when a change has been made, the motion the same in SI units."""
    if "." not in change.key:
        value: Any = {change.key: change.after}
        return assess(found.config, latency_s=found.latency_s, effort=REMEDY, **value)
    changed = apply_settings(found.config, {change.key: change.after})
    return assess(changed, start=found.start, latency_s=found.latency_s, effort=REMEDY)


@pytest.mark.parametrize("case", FIG8)
def test_the_four_cases_of_fig_8(case: str) -> None:
    found = fig8(case)
    assert found.region == FIG8[case][2]
    assert found.verdict == {"A": "stable", "B": "buzzes", "E": "stable", "D": "unstable"}[found.region]
    assert (found.cycle is not None) == (case == "b")
    assert bool(advise(found)) == (case in "bd")


def test_case_b_predicts_its_buzz() -> None:
    found = fig8("b").document["limit_cycle"]
    assert found["predicted"] is True
    assert found["amplitude_ticks"] == pytest.approx(0.0071, rel=0.01)
    # what the exact simulation of this case locks into: 9 periods up, 9 down
    explored = fig8("b").explored
    assert explored is not None
    (nine,) = [cycle for cycle in explored.cycles if (cycle.periods, cycle.kind) == (18, "symmetric")]
    assert nine.amplitude == pytest.approx(0.0093, rel=0.01)
    text = report(fig8("b"), [], "rig")
    assert "amplitude 0.00709 ticks at 65.2 Hz (describing function)" in text
    assert "wandering" in text


def test_advice_for_case_d_is_what_the_criterion_solved_for_gives() -> None:
    found = fig8("d")
    assert found.start is not None
    by_key = {change.key: change for change in advise(found)}
    assert set(by_key) == {"spring.stiffness", "servo.rate_hz", "deflection", "hand.damping", "spring.damping"}
    K = stiffness_max_dissipating(found.loop, found.start)
    assert 0.97 * K <= by_key["spring.stiffness"].after <= K
    rate = by_key["servo.rate_hz"].after
    assert margin(replace(found.loop, period=1.0 / rate), found.start) >= 0.0
    assert margin(replace(found.loop, period=1.03 / rate), found.start) < 0.0
    deepest = Start.in_ticks(found.loop, deflection=by_key["deflection"].after)
    assert margin(found.loop, deepest) >= 0.0
    assert margin(found.loop, Start.in_ticks(found.loop, deflection=1.05 * by_key["deflection"].after)) < 0.0


def test_advice_for_case_b_is_the_finest_decimation_that_is_enough() -> None:
    found = fig8("b")
    assert found.start is not None
    by_key = {change.key: change for change in advise(found)}
    assert set(by_key) == {"spring.stiffness", "encoder.decimation"}
    raw = found.loop.resolution / 2172
    margins = [margin(replace(found.loop, resolution=n * raw), found.start) for n in range(434, 2172)]
    assert by_key["encoder.decimation"].after == 434
    assert margins[0] >= 0.0 > max(margins[1:])
    assert found.config.plant.coulomb / (434 * found.loop.resolution / 2172 * 0.012) >= 0.5


configs = st.fixed_dictionaries(
    {
        "spring.stiffness": st.floats(1e-3, 1.0),
        "servo.rate_hz": st.sampled_from([50, 100, 333.3, 1000, 5000]),
        "encoder.decimation": st.integers(1, 3000),
        "amplifier.bandwidth_hz": st.sampled_from([0, 100, 3000]),
        "delay.computation_s": st.sampled_from([0.0, 0.0, 2e-4, 5e-3]),
        "plant.viscous": st.one_of(st.just(0.0), st.floats(1e-9, 1e-4)),
        "plant.coulomb": st.one_of(st.just(0.0), st.floats(1e-7, 5e-3)),
    }
)


@settings(max_examples=60, deadline=None)
@example({"spring.stiffness": 0.01}, None, 5e-324)
@given(configs, st.one_of(st.none(), st.floats(0.1, 50.0)), st.one_of(st.none(), st.floats(-5.0, 5.0)))
def test_every_advice_leads_to_safety(values: dict[str, Any], deflection: float | None, velocity: float | None) -> None:
    assume(deflection is None or velocity is None)
    found = assess(make(values), deflection=deflection, velocity=velocity, effort=GUARD)
    changes = advise(found)
    assert not changes or found.verdict != "stable"
    for change in changes:
        assert change.after != change.before
        then = after(found, change)
        assert then.region == change.region
        assert then.proven or (then.explored is not None and then.explored.admissible)
        assert then.verdict == "stable" or found.config.spring.damping > 0.0 or change.buzz < 0.02
        if change.key in ("spring.stiffness", "encoder.decimation", "delay.computation_s", "deflection"):
            assert change.after < change.before
    sizes = [change.size for change in changes if change.key != "hand.damping"]
    assert sizes == sorted(sizes)
    text = report(found, changes, "rig")
    assert all(change.key in text for change in changes)
    assert "nan" not in text


def test_the_rate_is_never_raised_beyond_what_the_bus_can_carry() -> None:
    shaky = {"servo.rate_hz": 2000, "encoder.decimation": 217, "plant.viscous": 4e-6, "spring.stiffness": 0.05}
    shaky |= {"safety.max_velocity": 0, "amplifier.peak_current": 0}  # or no motion is fast enough
    free = {change.key: change for change in advise(assess(make({**IDEAL, **shaky})))}
    assert "servo.rate_hz" not in free  # σ < ½ there: no rate helps
    shaky["plant.coulomb"] = 1e-2
    free = {change.key: change for change in advise(assess(make({**IDEAL, **shaky})))}
    assert free["servo.rate_hz"].after == pytest.approx(6250, rel=0.03)
    shaky["plant.viscous"] = 3e-6
    free = {change.key: change for change in advise(assess(make({**IDEAL, **shaky})))}
    assert free["servo.rate_hz"].after > 8000
    bus = {change.key: change for change in advise(assess(make({**IDEAL, **shaky, "driver.name": "canopen"})))}
    assert "servo.rate_hz" not in bus


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"servo.rate_hz": 10, "spring.stiffness": 0.5}, "sampling bound (11) is violated"),
        ({"spring.side": "negative"}, "the region is that of a two-sided spring"),
        ({"spring.stiffness": 0}, "no spring is rendered"),
        ({"driver.name": "canopen", "servo.rate_hz": 4000}, "classic CAN at 1 Mbit/s allows 2284 Hz"),
        ({"encoder.decimation": 1}, "Coulomb friction must hold 1.66 ticks"),
        (
            {"dither.target": "position", "dither.amplitude": 0.5, "dither.frequency_hz": 100},
            "Coulomb friction must hold 2.66 ticks of force",
        ),
    ],
)
def test_warnings(values: dict[str, Any], words: str) -> None:
    found = assess(make(values))
    assert any(words in warning for warning in found.warnings)
    assert words in " ".join(report(found, [], "rig").split())


@pytest.mark.parametrize(
    ("values", "motion", "words"),
    [
        ({"encoder.decimation": 1}, {"deflection": 100.0}, "does not move at all"),
        ({"encoder.decimation": 2172}, {"deflection": 7.0}, "beyond safety.max_excursion"),
        ({"encoder.decimation": 2172}, {"deflection": 5.9}, "trip on safety.max_velocity"),
        ({"spring.stiffness": 0.5, "encoder.decimation": 217}, {"deflection": 5.0}, "the amplifier's limit is 6 A"),
    ],
)
def test_warnings_about_a_motion(values: dict[str, Any], motion: dict[str, Any], words: str) -> None:
    assert any(words in warning for warning in assess(make(values), **motion).warnings)


def test_a_plain_rig_warns_of_nothing() -> None:
    assert assess(make({**IDEAL, "encoder.decimation": 100}), deflection=5.0).warnings == ()


def test_it_says_which_theorem_stands_behind_the_word_stable() -> None:
    proven, only_region = assess(make({**IDEAL, "encoder.decimation": 100})), assess(make({"spring.stiffness": 0.0148}))
    assert (proven.verdict, proven.proven, proven.document["criterion_margin"].keys()) == ("stable", True, {"paper"})
    assert "Theorem 1 proves that the energy S cannot rise at any speed (λ = 0.500, q = 0.500)." in flat(proven)
    # the lag of the amplifier asks for more than the delay it is taken for
    assert (only_region.region, only_region.verdict, only_region.proven) == ("F1", "stable", False)
    assert "No theorem proves it" in flat(only_region)


def flat(found: Assessment) -> str:
    return " ".join(report(found, [], "rig").split())


def test_a_velocity_and_a_deflection_exclude_each_other() -> None:
    with pytest.raises(ValueError, match="not both"):
        assess(make({}), velocity=1.0, deflection=1.0)


def test_the_drivers_latency_counts() -> None:
    plain, late = assess(make(IDEAL)), assess(make(IDEAL), latency_s=2e-4)
    assert late.numbers.tau_d - plain.numbers.tau_d == pytest.approx(0.2)
    assert plain.region == "A"
    assert late.region == "F1|F2"  # ½ + τ_D = 0.7 ≤ β = 0.75 < λ(0.2) = 0.753


def test_without_a_spring_nothing_is_infinite_by_mistake() -> None:
    found = assess(make({"spring.stiffness": 0}), deflection=2.0)
    assert (found.verdict, found.cycle, advise(found)) == ("stable", None, [])
    assert found.document["sampling_bound_ok"] is True
    assert math.isinf(found.document["mu"])
    assert "μ = ∞" in report(found, [], "rig")


def test_there_are_words_for_every_region_and_verdict() -> None:
    assert set(WHY) == set(MEANING)
    assert set(HEADLINES) == set(get_args(Verdict))


def test_the_text_of_case_d() -> None:
    found = fig8("d")
    text = report(found, advise(found), "rig.yaml")
    lines = text.splitlines()
    assert lines[0] == "rig.yaml, released at rest from 10.3 ticks: not stable: it will shake"
    assert "Region D: locally unstable" in text
    assert "One of these changes is enough to make it stable:" in lines
    assert "  spring.stiffness     0.012 → 0.0068 N m/rad           a softer spring (region E)" in lines
    assert "  servo.rate_hz        100 → 270 Hz                     a faster servo (region E)" in lines
    assert max(map(len, lines)) <= 100


def test_the_text_of_a_device_shows_printed_and_recomputed_numbers() -> None:
    freedom = TABLE_II[1]
    found = assess(load_config("freedom6"))
    text = " ".join(report(found, advise(found), freedom.name, freedom).split())
    assert "Freedom 6, at any speed: stable for slow motions only" in text
    assert "β 0.025 0.004167 -83.3 %" in text
    assert "no rounding explains it" in text
    assert "a hand with 25 % of the table's human operator" in text
    assert "too soft for a wall" in text


def test_where_nothing_helps_it_says_so() -> None:
    found = assess(make({**IDEAL, "plant.coulomb": 0.0, "encoder.decimation": 10}))
    assert advise(found) == []
    assert "No change of one setting" in report(found, [], "rig")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1234"),
        (0.01234, "0.0123"),
        (1.5e-6, "1.5e-6"),
        (math.inf, "∞"),
        (None, "–"),
        (-0.5, "-0.500"),
    ],
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize("case", [*FIG8, "every motion", "far from the boundaries"])
def test_the_figure_is_drawn(case: str, tmp_path: Path) -> None:
    if case in FIG8:
        found = fig8(case)
    else:
        found = assess(make({} if case.startswith("far") else {"servo.rate_hz": 100, "encoder.decimation": 200}))
    path = tmp_path / "plane.svg"
    check_figure(found, advise(found), path, "rig")
    drawing = path.read_text()
    assert f"region {found.region}" in drawing.replace("|", "|")
    assert "operating point" in drawing


def test_a_figure_without_a_spring_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no operating point"):
        check_figure(assess(make({"spring.stiffness": 0})), [], tmp_path / "x.png", "rig")


def test_virtual_damping_is_offered_where_there_is_none_and_it_alone_is_enough() -> None:
    shaky = make({"spring.stiffness": 0.3})
    asked = deflection_ticks("30deg", shaky)
    found = assess(shaky, deflection=asked)
    by_key = {change.key: change for change in advise(found, Unit("deg", deflection_ticks("1deg", shaky)))}
    damping, motion = by_key["spring.damping"], by_key["deflection"]
    assert (damping.before, motion.before, motion.unit) == (0.0, pytest.approx(30.0), "deg")
    then = assess(make({"spring.stiffness": 0.3, "spring.damping": damping.after}), deflection=asked)
    assert then.verdict == "stable"
    gentler = assess(shaky, deflection=deflection_ticks(f"{motion.after}deg", shaky))
    assert gentler.verdict == "stable"
    assert "30 → " in advice_text(found, [motion])
    assert "(simulated exactly)" in advice_text(found, [damping])
