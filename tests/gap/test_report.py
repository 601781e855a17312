"""The first screen of the report: what is missing, where it shows, how sure, how far the gap shrank, what is left."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.effects.catalogue import CATALOGUE
from hapticd.figures.style import style
from hapticd.gap import text as gap_text
from hapticd.gap.consequences import consequences
from hapticd.gap.figures import all_figures, over_time
from hapticd.gap.next_step import next_step
from hapticd.gap.profile import Profile
from hapticd.gap.recording import Recording
from hapticd.gap.report import page
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Remainder, Step

from .synthetic import model

PLACE = {"coordinate": "speed, against the motion", "range": [0.02, 2.0], "share": 0.62}
STEP = Step(
    "stribeck",
    {"s": Estimate(0.412, (0.38, 0.44), ""), "omega_s": Estimate(1.5, (1.2, 1.9), "rad/s")},
    gap_before=2.31e-4,
    gap_after=1.04e-5,
    share=0.97,
    evidence=9.8,
    log_likelihood_gain=400.0,
    indistinguishable_from=(),
    ranking=(Ranked("stribeck", 400.0, 9.8, 0.0), Ranked("coulomb_friction", 80.0, 5.0, 7.25)),
    entry={"s": 0.412, "omega_s": 1.5},
)
LEFT = ({"coordinate": "way since a reversal, against the motion", "share": 0.2, "p_value": 1e-6},)


def profile(rows: int = 4000) -> Profile:
    """A friction that the model lacks, of which a tenth is left."""
    time_s = 1e-3 * np.arange(rows, dtype=np.float64)
    velocity = 20.0 * np.sin(3.0 * time_s)
    before = -2e-4 * np.sign(velocity) * np.exp(-np.abs(velocity) / 2.0)
    moves = np.abs(velocity) > 0.05
    current = 0.1 * np.cos(3.0 * time_s)
    position = -(20.0 / 3.0) * np.cos(3.0 * time_s)
    return Profile("lab", time_s, position, velocity, current, moves, before, 0.1 * before, np.full(rows, 1e-6))


FOUND = GapResult(
    "effect_found",
    "Missing: stribeck (missing 0.000231 N m before, 1.04e-05 N m after).",
    ("stribeck",),
    (STEP,),
    GapNumbers(2.3e-4, 1.02e-5, 2.31e-4, 1.04e-5, 1e-6, "N m"),
    Remainder(0.002, "0.2 % of the missing force's power is left.", ()),
    where=(PLACE, {"coordinate": "position", "range": [0.0, 1.0], "share": 0.001}),
    prediction={
        "horizon_s": 0.05,
        "k_step": {"before": 0.05, "after": 0.0003},
        "free_run": {"before": 1.7, "after": 0.011},
        "unit": "rad",
    },
    recording={"missed": 0, "jitter_s": 2e-6, "period_s": 1e-3, "warnings": ["lab.csv: the motion goes one way"]},
    details={"samples": 4000, "blocks": 20, "candidates": list(CATALOGUE), "needed_standard_errors": 4.2},
    profiles=(profile(),),
)


def whole_page(result: GapResult, run: Recording) -> str:
    changes: dict[str, Any] = consequences(model(), model(), 0.0)
    return page(result, [run], changes, CATALOGUE, "plant: {}\n")


def first_screen(result: GapResult, run: Recording) -> str:
    """Text of the page up to its first figure."""
    whole = whole_page(result, run)
    assert "http://" not in re.sub(r"data:[^\"]*", "", whole)
    head = whole[whole.index("<h1>") : whole.index("<figure>")]
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", head))


def test_all_questions_are_answered_with_numbers_and_units(nominal_run: Recording) -> None:
    text = first_screen(FOUND, nominal_run)
    assert "Missing from the model: stribeck" in text
    assert "s = 0.412 (0.38 … 0.44)" in text
    assert "omega_s = 1.5 rad/s (1.2 … 1.9)" in text
    assert "62 % as friction that depends on the speed, most of it from 0.02 to 2 rad/s" in text
    assert "function of the position" not in text
    assert "9.8 standard errors" in text
    assert "the next best, coulomb_friction, is 7.2 standard errors behind" in text
    assert "231 µN m → 10.4 µN m" in text
    assert "Noise floor: 1 µN m" in text
    assert "50 ms ahead: off by 50 mrad before, 300 µrad after" in text
    assert "0.2 % of the missing force&#39;s power is left" in text
    assert "the motion goes one way" in text
    assert text.index("Timing of the data: 0 of 4000 samples missed, jitter 2 µs") < text.index("Missing: stribeck")


def test_a_linear_device_is_told_of_in_its_units(nominal_run: Recording) -> None:
    text = first_screen(replace(FOUND, gap=replace(FOUND.gap, unit="N")), nominal_run)
    assert "from 0.02 to 2 m/s" in text
    assert "10.4 µN RMS of the missing force" in text


def test_an_ambiguous_answer_names_both_in_the_title(nominal_run: Recording) -> None:
    ambiguous = replace(FOUND, verdict="ambiguous", steps=(replace(STEP, indistinguishable_from=("presliding",)),))
    text = first_screen(ambiguous, nominal_run)
    assert "Missing: stribeck or presliding; these data do not distinguish which" in text
    assert "do not distinguish it from presliding" in text


@pytest.mark.parametrize(
    ("tried", "said"), [(len(CATALOGUE), "Every effect of the catalogue was tried"), (1, "1 of the catalogue's")]
)
def test_nothing_missing_says_what_was_tried(nominal_run: Recording, tried: int, said: str) -> None:
    details = {**FOUND.details, "candidates": list(CATALOGUE)[:tried]}
    none = replace(FOUND, verdict="no_missing_effect", effects=(), steps=(), where=(), details=details)
    text = first_screen(none, nominal_run)
    assert "Nothing is missing from the model" in text
    assert said in text.replace("&#39;", "'")
    assert "none reaches the 4.2 standard errors that chance reaches in 0.5 % of recordings" in text
    assert "there is nothing to show" in text


@pytest.mark.parametrize(
    ("verdict", "steps", "title"),
    [
        ("partly_explained", (STEP,), "Missing from the model: stribeck, and something that no effect explains"),
        ("unexplained", (), "Something is missing that no effect explains"),
    ],
)
def test_structure_that_is_left_is_said_and_drawn(
    nominal_run: Recording, verdict: Any, steps: tuple[Step, ...], title: str
) -> None:
    left = replace(
        FOUND,
        verdict=verdict,
        steps=steps,
        effects=tuple(step.effect for step in steps),
        remainder=Remainder(0.3, "30 % is left: friction that builds up after a reversal.", LEFT),
    )
    text = first_screen(left, nominal_run)
    assert title in text
    assert "30 % is left: friction that builds up after a reversal." in text
    assert "way since a reversal, against the motion" in whole_page(left, nominal_run)
    assert "left" in all_figures(left)


def test_how_sure_it_is_that_nothing_is_missing(nominal_run: Recording) -> None:
    nothing = replace(FOUND, verdict="no_missing_effect", effects=(), steps=())
    tried = "was tried; on held-out data"
    assert f"{tried} none reaches the 4.2 standard errors" in first_screen(nothing, nominal_run)
    quiet = replace(nothing, details={**FOUND.details, "is_quiet": True})
    assert "No effect was tried: the missing force is no more than the noise of the best device" in first_screen(
        quiet, nominal_run
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, "hapticd gap RUN… --validate RUN"),
        ({"verdict": "partly_explained", "remainder": Remainder(0.3, "", LEFT)}, "reverses often"),
        ({"verdict": "no_missing_effect", "effects": (), "steps": ()}, "Keep the model"),
        ({"verdict": "ambiguous"}, "goes faster, slower and both ways"),
        ({"verdict": "ambiguous", "next_experiment": {"words": "Play a chirp."}}, "Play a chirp."),
        ({"verdict": "unexplained", "effects": (), "steps": ()}, "goes both ways at many speeds"),
        ({"verdict": "unexplained", "effects": (), "steps": (), "where": ()}, "slow ramps, steps and a chirp"),
        ({"interrupted": True}, "Let the search run to its end"),
    ],
)
def test_every_verdict_says_what_to_do_next(nominal_run: Recording, change: dict[str, Any], said: str) -> None:
    result = replace(FOUND, **change)
    assert said in next_step(result.to_json())
    planned = {"experiment": None, "file": None, **(result.next_experiment or {})}
    text = first_screen(replace(result, next_experiment=planned if result.next_experiment else None), nominal_run)
    assert said in text[text.index("What to do next") :]


def test_an_effect_links_to_what_is_known_of_it(nominal_run: Recording) -> None:
    whole, spec = whole_page(FOUND, nominal_run), CATALOGUE["stribeck"]
    assert '<a href="#stribeck">' in whole
    about = whole[whole.index('<h3 id="stribeck">') :]
    assert spec.where_it_shows in html.unescape(about)
    assert "Its page: docs/effects/stribeck.md" in about


def test_where_a_law_is_in_an_angle_all_turns_are_one() -> None:
    position = np.linspace(-30.0, 30.0, 4000)
    before = 1e-4 * np.sin(position)
    turning = replace(FOUND.profiles[0], position=position, before=before, after=0.0 * before, moves=position > -40.0)
    gravity = replace(FOUND, effects=("gravity",), steps=(replace(STEP, effect="gravity"),), profiles=(turning,))
    panel = all_figures(gravity)["laws"].axes[0]
    angle, force = np.asarray(panel.lines[0].get_xydata()).T
    assert np.abs(angle).max() <= np.pi
    assert force == pytest.approx(100.0 * np.sin(angle), abs=5.0)
    assert panel.get_xlabel() == "position within a turn, rad"
    assert all_figures(replace(FOUND, profiles=(turning,)))["laws"].axes[0].get_xlabel() == "position, rad"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0 m"),
        (4.82e-5, "48.2 µm"),
        (0.084709, "84.7 mm"),
        (1.7, "1.7 m"),
        (float("inf"), "too large to compute"),
        (None, "too large to compute"),
    ],
)
def test_a_magnitude_has_the_prefix_that_suits_it(value: float | None, said: str) -> None:
    assert gap_text.sized(value, "m") == said


def test_bad_timing_comes_before_the_figures(nominal_run: Recording) -> None:
    late = replace(FOUND, recording={**FOUND.recording, "missed": 40, "jitter_s": 1e-4})
    assert "Timing of the data: 40 of 4040 samples missed, jitter 100 µs (10 % of a period)" in first_screen(
        late, nominal_run
    )


def test_what_was_found_before_an_interruption_says_so(nominal_run: Recording) -> None:
    text = first_screen(replace(FOUND, interrupted=True), nominal_run)
    assert "Interrupted; missing from the model, as far as the search went: stribeck" in text
    nothing = first_screen(replace(FOUND, interrupted=True, effects=(), steps=()), nominal_run)
    assert "as far as the search went: nothing" in nothing
    assert "The search was interrupted." in nothing


def test_orders_that_were_chosen_are_told_with_the_ripple(nominal_run: Recording) -> None:
    ripple = replace(
        STEP,
        effect="torque_ripple",
        parameters={"amplitudes[0]": Estimate(1e-3, (9e-4, 1.1e-3), "N m")},
        entry={"orders": [7.0, 14.0], "amplitudes": [1e-3, 2e-4]},
    )
    assert "orders = 7, 14" in first_screen(replace(FOUND, steps=(ripple,)), nominal_run)


def test_a_law_that_contains_the_named_one_is_not_indistinguishable_from_it() -> None:
    step = {
        "effect": "constant_bias",
        "indistinguishable_from": ["asymmetric_coulomb"],
        "ranking": [
            {"effect": "return_spring", "gain": 43.0, "evidence": 8.7, "behind": 0.0},
            {"effect": "constant_bias", "gain": 42.0, "evidence": 8.5, "behind": 0.0},
            {"effect": "gravity", "gain": 17.0, "evidence": 4.3, "behind": 6.7},
        ],
    }
    assert gap_text.behind(step) == (
        "asymmetric_coulomb is the same law in other parameters; return_spring, of which it is a limit, predicts no better; "
        "the next best, gravity, is 6.7 standard errors behind"
    )


def test_a_shaft_that_never_moves_has_no_figures_of_force() -> None:
    still = replace(FOUND.profiles[0], moves=np.zeros(4000, dtype=bool))
    assert set(all_figures(replace(FOUND, profiles=(still,)))) == {"ranking-1"}


def test_the_law_that_was_missing_can_be_read_off_the_figure() -> None:
    panel = all_figures(FOUND)["laws"].axes[1]
    before, after = (np.asarray(panel.lines[k].get_xydata()) for k in (0, 1))
    slow = np.abs(before[:, 0]) > 1.0  # where a bin is narrow against the law
    speed, force = before[slow].T
    assert force == pytest.approx(-200.0 * np.sign(speed) * np.exp(-np.abs(speed) / 2.0), rel=0.15, abs=2.0)
    assert after[:, 1] == pytest.approx(0.1 * before[:, 1])
    assert panel.get_xlabel() == "velocity, rad/s (square-root scale)"
    assert panel.figure.axes[0].get_ylabel() == "missing force, µN m"


@pytest.mark.parametrize("recordings", [1, 3])
def test_the_daemons_long_name_leaves_title_and_legend_readable(recordings: int) -> None:
    named = replace(profile(), name="run-20261127T154344.941Z-excite-steps.arrow")
    with style():
        figure = over_time([named] * recordings, "N m", 1e-6)
        figure.draw_without_rendering()
    (legend,) = [one for one in (*figure.legends, *(axis.get_legend() for axis in figure.axes)) if one is not None]
    assert [text.get_text() for text in legend.get_texts()] == [
        "model as given",
        "improved model, ± 1 standard deviation",
        "noise floor",
    ]
    page_box, legend_box = figure.bbox, legend.get_window_extent()
    titles = [axis._left_title.get_window_extent() for axis in figure.axes]
    assert not any(legend_box.overlaps(box) for box in [*titles, *(axis.bbox for axis in figure.axes)])
    for box in (legend_box, *titles):
        assert page_box.containsx(box.x0)
        assert page_box.containsx(box.x1)
        assert page_box.containsy(box.y1)


@pytest.mark.parametrize("rows", [4000, 500], ids=["thinned", "every sample"])
def test_no_line_crosses_a_hole_in_the_record(rows: int) -> None:
    whole = profile(rows)
    end = whole.time_s[-1]
    there = (whole.time_s < 0.4 * end) | (whole.time_s > 0.7 * end)
    there &= (whole.time_s < 0.1 * end) | (whole.time_s > 0.2 * end) | (np.abs(whole.time_s - 0.15 * end) < 0.003)
    arrays = {name: values[there] for name, values in vars(whole).items() if name != "name"}
    moving = replace(whole, **{**arrays, "moves": np.ones(there.sum(), dtype=bool)})
    axis = over_time([moving], "N m", 1e-6).axes[0]
    holes = np.array([[0.12, 0.14], [0.16, 0.18], [0.45, 0.65]]) * end
    for line in axis.lines[:2]:
        drawn = np.asarray(line.get_xdata())
        from_s, to_s = drawn[:-1, None], drawn[1:, None]
        assert not ((from_s < holes[:, 0]) & (to_s > holes[:, 1])).any()
        assert np.nanmax(np.diff(drawn)) < 0.02 * end
        assert drawn[0] < 0.01 * end
        assert drawn[-1] > 0.99 * end
        between = np.abs(drawn - 0.15 * end) < 0.01 * end
        assert between.sum() >= 2, "what is between two holes is drawn"
    (band,) = axis.collections
    spans = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in band.get_paths()]
    assert len(spans) == 4
    assert all(((lo > holes[:, 0]) | (hi < holes[:, 1])).all() for lo, hi in spans)


def test_holes_too_short_to_be_seen_leave_the_line_whole() -> None:
    whole = profile(20_000)
    there = np.arange(20_000) % 200 >= 12
    arrays = {name: values[there] for name, values in vars(whole).items() if name != "name"}
    drawn = np.asarray(over_time([replace(whole, **arrays)], "N m", 1e-6).axes[0].lines[0].get_xdata())
    assert np.isfinite(drawn).all()


def test_a_linear_device_lacks_a_force_and_no_torque() -> None:
    place = {"coordinate": "position", "range": [0.1, 0.2], "share": 0.5}
    assert gap_text.places([place], "N") == [
        "50 % as a force that depends on the position, most of it from 0.1 to 0.2 m"
    ]
    assert gap_text.places([place], "N m")[0].startswith("50 % as a torque that depends on the position")
