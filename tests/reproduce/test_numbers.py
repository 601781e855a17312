"""What a reproduction finds, against the paper's printed numbers and an independent exact simulation."""

from __future__ import annotations

import pytest
from scipy.integrate import quad

from hapticd.figures.markup import text
from hapticd.reproduce.dither import dither_table, dithered
from hapticd.reproduce.fig_09 import MOTION, eq_54
from hapticd.reproduce.items import compare, show
from hapticd.stability.devices import TABLE_II

from .conftest import Made


def test_what_differs_is_known_and_has_a_reason(made: Made) -> None:
    assert [(row["item"], row["what"]) for row in made.document["differ"]] == [
        ("table2", "Freedom 6: β"),
        ("fig8", "(b) this run: amplitude"),
        ("fig8", "(b) this run: frequency"),
        ("fig8", "(b) starts that end within 15 % of the describing function's amplitude"),
        ("fig8", "(a) with 3 kHz and 14 bits stops at"),
        ("fig8", "(a) with 3 kHz and 14 bits moves for"),
        ("fig9", "stored energy in that period, in region A"),
        ("fig9", "largest E_g less bound (47) in it"),
        ("fig9", "the same E_gq"),
        ("fig12", "starts that end within 15 % of the describing function's amplitude"),
    ]
    assert all(row["note"] for row in made.document["differ"])
    assert made.document["agree"] == made.document["comparisons"] - 10


def test_table_i_goes_both_ways(made: Made) -> None:
    numbers = made.numbers("table1")
    assert (numbers["mu"], numbers["beta"], numbers["sigma"]) == pytest.approx((523.3, 0.75, 1.001), rel=1e-3)
    assert numbers["tau_d"] == pytest.approx(0.2)
    assert numbers["largest_relative_error"] < 1e-15


@pytest.mark.parametrize(
    ("what", "recomputed"),
    [
        ("Delta: μ", 155.2), ("Omega: μ", 136.6), ("Impulse Engine: μ", 1000.0), ("Impulse Engine: β", 0.125),
        ("Impulse Engine: σ", 0.955), ("MIT Toolhandle: μ", 38.08), ("Phantom 1.0: μ", 70.9), ("Phantom 1.0: β", 0.0049),
        ("Freedom 6: β", 0.0042),
    ],
)  # fmt: skip
def test_table_ii_recomputed(made: Made, what: str, recomputed: float) -> None:
    assert made.compared("table2")[what]["ours"] == pytest.approx(recomputed, rel=0.01)


def test_table_ii_has_every_printed_number(made: Made) -> None:
    printed = [float(value) for device in TABLE_II for value in (device.mu, device.beta, device.sigma)]
    assert [row["printed"] for row in made.document["items"]["table2"]["comparisons"]] == printed
    assert made.numbers("table2")["unexplained"] == ["Freedom 6 beta"]


@pytest.mark.parametrize(("name", "count"), [("fig6", 5), ("fig7", 5)])
def test_maps_keep_every_promise(made: Made, name: str, count: int) -> None:
    numbers = made.numbers(name)
    assert numbers["exceptions"] == []
    regions = numbers["regions"]
    assert len(regions) >= count
    points = sum(row["points"] for row in regions.values())
    assert points == 4 * len(numbers["study"]["beta"]) * len(numbers["study"]["sigma"])
    assert all(row["agree"] == 1.0 for row in regions.values() if row["agree"] is not None)


def test_fig_8_by_the_servo_loop(made: Made) -> None:
    runs = made.numbers("fig8")
    assert [runs[case]["region"] for case in "abcd"] == ["A", "B", "E", "D"]
    assert [runs[case]["outcome"] for case in "abcd"] == ["monotone", "persistent", "monotone", "growing"]
    assert runs["a"]["final_ticks"] == pytest.approx(-0.725, abs=5e-4)
    assert runs["a"]["rest_periods"] == 649
    assert runs["c"]["rest_periods"] == 7
    assert 0.005 < runs["b"]["amplitude_ticks"] < 0.025
    assert 35.0 < runs["b"]["frequency_hz"] < 70.0
    cycles = runs["b"]["cycles"]
    (eighteen,) = (cycle for cycle in cycles if (cycle["periods"], cycle["kind"]) == (18, "symmetric"))
    assert eighteen["amplitude_ticks"] == pytest.approx(0.0093, abs=5e-5)
    assert sum(cycle["share"] for cycle in cycles) == pytest.approx(1.0)
    assert 0.0 <= runs["b"]["predicted_within"] < 0.5


def test_no_dither_lets_region_b_rest_and_a_fast_one_makes_it_buzz_less() -> None:
    alone = dithered(2172, None)
    slow, fast = (dithered(2172, ("position", "sine", hertz), 0.5) for hertz in (20.0, 250.0))
    assert (alone.at_rest, slow.at_rest, fast.at_rest) == (0, 0, 0)
    assert fast.largest_cycle < 0.1 * alone.largest_cycle
    assert slow.largest_cycle > 5.0 * alone.largest_cycle
    table = dither_table((0.5,))
    assert [len(row) for row in table.rows] == [len(table.header)] * 16


def test_fig_9_the_counterexample_and_the_loops(made: Made) -> None:
    numbers = made.numbers("fig9")
    assert numbers["counterexample"]["before"] == pytest.approx(12.995, abs=5e-4)
    assert numbers["counterexample"]["after"] == pytest.approx(13.103, abs=5e-4)
    assert numbers["counterexample"]["excess"] > 0.1
    assert numbers["counterexample"]["linear"][1] < numbers["counterexample"]["linear"][0]
    generated = numbers["generated"]
    assert generated["physical"] == generated["quantised"] == 0.0
    assert 0.0 < generated["digital"] < generated["delayed"]


def test_eq_54_against_an_adaptive_quadrature() -> None:
    printed, corrected, midpoint = eq_54(*MOTION)
    xi_h, xi_l, xi_end = MOTION
    edges = [tick for tick in range(10) if xi_l < tick < xi_end]
    exact = quad(lambda xi: xi_h % 1.0 - xi % 1.0, xi_l, xi_end, points=edges)[0]
    assert corrected == pytest.approx(exact, abs=1e-12)
    assert midpoint == pytest.approx(exact, abs=1e-5)
    assert abs(printed - exact) > 0.1


def test_describing_function_figures(made: Made) -> None:
    first = made.numbers("fig11")["cycles"][0]
    assert first["stable"] is True
    assert 0.0 < first["amplitude"] < 1.0
    large = made.numbers("fig12")
    assert large["omega_large"] == pytest.approx(large["omega_large_series"], rel=1e-3)
    sigma = [line["sigma_at_beta_0"] for line in large["small"]]
    assert sigma == sorted(sigma)
    assert sigma[-1] < 0.5


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("x", "x"),
        (714, "714"),
        (-0.725, "−0.725"),
        (6.28e-6, "6.28·10⁻⁶"),
        (1007.8, "1007.8"),
        (float("inf"), "∞"),
        (0.0, "0"),
    ],
)
def test_numbers_as_text(value: float | str, shown: str) -> None:
    assert show(value) == shown


def test_words_as_html() -> None:
    assert text("ξ̇_max < τ_D² and `hapticd map`") == "ξ̇<sub>max</sub> &lt; τ<sub>D</sub>² and <code>hapticd map</code>"


def test_a_comparison_agrees_within_its_tolerance() -> None:
    assert compare("x", "paper", 1.0, 1.25, 0.25).agrees
    assert not compare("x", "paper", 1.0, 1.2501, 0.25).agrees
    assert compare("x", "paper", 1.0, 1.25, 0.0).difference == 0.25
