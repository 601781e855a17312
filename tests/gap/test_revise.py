"""Effects added early are looked at again: dropped when superfluous, replaced when another does better."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hapticd.gap import ties
from hapticd.gap.candidates import BUILDERS
from hapticd.gap.context import Context
from hapticd.gap.evidence import Scored, window_loss
from hapticd.gap.fit import Fit, Solution, fit
from hapticd.gap.hypothesis import Hypothesis, Term
from hapticd.gap.predict import Segment
from hapticd.gap.prepare import prepare
from hapticd.gap.revise import Round, dropped, replaced
from hapticd.gap.search import Data, Judged, judge
from hapticd.plant.layout import device_vector, word

if TYPE_CHECKING:
    from collections.abc import Callable


def base_model(hidden: Callable[..., Any], effects: list[dict[str, Any]]) -> tuple[Data, Judged]:
    """Windows of a recording, and the nominal model on them."""
    recording, model = hidden(effects)
    base = Hypothesis(device_vector(model))
    data = prepare([recording], base)
    return data, judge(data, fit(data.segments, base, np.zeros(0), [s.first_states() for s in data.segments]))


def with_effect(data: Data, present: Judged, slug: str) -> Judged:
    """One more effect, fitted."""
    context = Context(data.segments, present.fit, present.hypothesis.device(present.fit.solution.u, 0).vector)
    term = BUILDERS[slug](context)[0]
    u = np.concatenate([present.fit.solution.u, term.start])
    return judge(data, fit(data.segments, present.hypothesis.with_term(term), u, present.fit.solution.states))


def rounds_of(data: Data, present: Judged, *slugs: str, rivals: tuple[str, ...] = ()) -> tuple[Judged, list[Round]]:
    """Effects added one after the other; `rivals` competed in the first round."""
    rounds = []
    for slug in slugs:
        judged = {name: with_effect(data, present, name) for name in (slug, *(rivals if not rounds else ()))}
        rounds.append(Round(slug, present, judged[slug], judged))
        present = judged[slug]
    return present, rounds


def test_an_effect_that_a_later_one_makes_superfluous_is_dropped(hidden: Callable[..., Any]) -> None:
    data, nominal = base_model(hidden, [{"name": "coulomb_friction", "r": 0.1}])
    present, rounds = rounds_of(data, nominal, "viscous_friction", "coulomb_friction")
    present, kept = dropped(data, present, rounds, 0)
    assert [found.winner for found in kept] == ["coulomb_friction"]
    assert present.hypothesis.slugs == ("coulomb_friction",)


def test_effects_that_are_needed_stay(hidden: Callable[..., Any]) -> None:
    effects = [{"name": "viscous_friction", "r": 1.0}, {"name": "constant_bias", "tau_0": 1e-4}]
    data, nominal = base_model(hidden, effects)
    present, rounds = rounds_of(data, nominal, "viscous_friction", "constant_bias", rivals=("quadratic_drag",))
    _, kept = dropped(data, present, rounds, 0)
    assert kept == rounds
    _, kept, changed = replaced(data, present, rounds, 0, lambda share, text: None, 1)
    assert not changed
    assert [found.winner for found in kept] == ["viscous_friction", "constant_bias"]


def test_a_stand_in_is_replaced(hidden: Callable[..., Any]) -> None:
    effects = [{"name": "inertia_error", "r": 0.1}, {"name": "constant_bias", "tau_0": 1e-4}]
    data, nominal = base_model(hidden, effects)
    present, rounds = rounds_of(data, nominal, "torque_constant_error", "constant_bias", rivals=("inertia_error",))
    present, kept, changed = replaced(data, present, rounds, 0, lambda share, text: None, 1)
    assert changed
    assert [found.winner for found in kept] == ["constant_bias", "inertia_error"]
    assert present.hypothesis.slugs == ("constant_bias", "inertia_error")


def test_a_law_contains_its_limit() -> None:
    def term(slug: str, **form: object) -> Term:
        return Term(slug, (), lambda vector, u: None, lambda u: {}, (), form=form)

    assert ties.contains(term("thermal_drift"), "coulomb_friction")
    assert ties.contains(term("torque_ripple", orders=[1.0, 7.0]), "gravity")
    assert not ties.contains(term("torque_ripple", orders=[2.0, 7.0]), "gravity")
    assert not ties.contains(term("coulomb_friction"), "thermal_drift")


def test_a_law_comes_before_the_choice_of_each_ticks_fate() -> None:
    """Twenty per cent worse would be no tie between two laws that are equally simple."""
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((400, 32))
    bend = np.linspace(-1.0, 1.0, 32) ** 2
    block = np.arange(400) // 20

    def judged(slug: str, error: float, **more: Any) -> Judged:
        term = Term(slug, (), lambda vector, u: None, lambda u: {}, (), **more)
        left = noise + error * np.outer(rng.standard_normal(400), bend)
        square = np.mean(left**2, axis=1)
        solution = Solution(Hypothesis(np.zeros(1), (term,)), np.zeros(0), (), square, window_loss(square, 32.0))
        return Judged(Fit(solution, [left], None), Scored(solution.loss, square, (left,)))  # type: ignore[arg-type]

    data = Data([cast(Segment, SimpleNamespace(count=400, length=32))], block)
    fates = judged("dropped_samples", 0.0, lost=(np.zeros(1, dtype=np.uint8),))
    for error, winner in ((0.05, "torque_ripple"), (1.0, "dropped_samples")):
        round_of = {"dropped_samples": fates, "torque_ripple": judged("torque_ripple", error)}
        assert ties.first(round_of, round_of, data) == winner


def test_a_ripple_that_is_mostly_once_per_revolution_is_gravity(hidden: Callable[..., Any]) -> None:
    data, nominal = base_model(hidden, [{"name": "gravity", "m_g_l": 4e-3, "theta_0": 0.7}])
    gravity = with_effect(data, nominal, "gravity")
    index = word("torque_ripple.amplitudes[0]")

    def ripple(orders: list[float], sizes: list[float]) -> Judged:
        term = Term(
            "torque_ripple",
            (),
            lambda vector, u: vector.__setitem__(index, 0.0),
            lambda u: {f"amplitudes[{k}]": size for k, size in enumerate(sizes)},
            (),
            form={"orders": orders},
        )
        solution = replace(gravity.fit.solution, hypothesis=Hypothesis(np.zeros(1), (term,)), u=np.zeros(0))
        square, left = 0.64 * gravity.held_out.mean_square, tuple(0.8 * part for part in gravity.held_out.residuals)
        better = Scored(window_loss(square, float(left[0].shape[1])), square, left)
        return Judged(replace(gravity.fit, solution=solution), better)

    for orders, sizes, winner in (
        ([3.0, 1.0], [1e-6, 4e-3], "gravity"),
        ([3.0, 1.0], [4e-3, 1e-6], "torque_ripple"),
    ):
        round_of = {"gravity": gravity, "torque_ripple": ripple(orders, sizes)}
        assert round_of["torque_ripple"].ahead_of(gravity, data) > ties.RESOLVED
        assert ties.first(round_of, round_of, data) == winner
