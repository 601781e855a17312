"""The fit: parameters of hidden effects, their intervals, and a held-out score that costs what a parameter costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.answer import estimates_of
from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import scale_of
from hapticd.gap.covariance import covariance_of
from hapticd.gap.fit import Fit
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import parameters_of_term, term

SECONDS = 8.0
HIDDEN: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "constant_bias": ({"tau_0": 4e-4}, {"tau_0": 1e-4}),
    "transport_delay": ({"t_d": 0.8e-3}, {"t_d": 0.5e-3}),
    "stribeck": ({"s": 0.5, "omega_s": 3.0}, {"s": 0.3, "omega_s": 2.0}),
}


@pytest.mark.parametrize("slug", HIDDEN)
def test_parameters_are_recovered_to_a_percent(hidden: Callable[..., Any], slug: str) -> None:
    true, start = HIDDEN[slug]
    recording, model = hidden([{"name": slug, **true}], 6, SECONDS)
    fit = nominal_fit(problem_of([recording], model)).extended(term(slug, start, (), 0.1))
    before = fit.log_likelihood
    fit.approach(5, 5).maximise()
    assert fit.log_likelihood > before
    for coordinate, value in zip(fit.terms[0].coordinates, fit.u[fit.columns(0)], strict=True):
        found = np.exp(value) if coordinate.is_log else value
        assert found == pytest.approx(true[coordinate.name], rel=0.01), coordinate.name


def test_intervals_of_a_bias_hold_the_truth(hidden: Callable[..., Any]) -> None:
    """Under a coloured torque, where scores hang together."""
    z = []
    for seed in range(30, 38):
        recording, model = hidden([{"name": "constant_bias", "tau_0": 3e-4}], seed, 5.0, Coloured(0.1, 0.03))
        problem = problem_of([recording], model)
        fit = nominal_fit(problem, [term("constant_bias", {"tau_0": 2e-4}, (), 0.1)])
        fit.held_out()
        deviation = float(np.sqrt(covariance_of(fit)[5, 5]))
        assert 0.0 < deviation < 3e-4
        z.append((float(fit.u[5]) - 3e-4) / deviation)
    assert np.abs(z).max() < 4.0
    assert 0.3 < float(np.sqrt(np.mean(np.square(z)))) < 2.5


@pytest.fixture(scope="module")
def nothing(hidden: Callable[..., Any]) -> Fit:
    recording, model = hidden([], 7, SECONDS, Coloured(0.05, 0.05))
    return nominal_fit(problem_of([recording], model))


def test_noise_is_what_was_put_in(nothing: Fit) -> None:
    """The disturbance of the whole model, in the time in which a shaft answers to it: density s²τ."""
    values = nothing.noise_values()
    true = (0.05 * 2e-3) ** 2 * 0.05
    assert 0.25 * true < values[2] ** 2 * values[3] + 0.5 * values[0] ** 2 < 4.0 * true
    assert 0.0 < values[1] < nothing.problem.series.resolution


def test_what_is_no_number_is_no_better(nothing: Fit) -> None:
    """Or a line search from there would never end."""
    fit = nothing.on(nothing.problem)
    assert not fit.move(np.full_like(fit.u, np.nan))
    fit.log_likelihood = np.nan
    assert not fit.move(fit.u)


def test_a_parameter_that_is_not_needed_gains_nothing_held_out(nothing: Fit) -> None:
    fit = nothing.extended(term("constant_bias", {"tau_0": 1e-5}, (), 0.1)).maximise()
    assert fit.log_likelihood >= nothing.log_likelihood - 0.1
    held, base = float(fit.held_out().sum()), float(nothing.held_out().sum())
    assert base == pytest.approx(float(nothing.out["log_p"].sum()))
    assert held - base < fit.log_likelihood - nothing.log_likelihood + 0.5
    assert held - base < 5.0


def test_scores_are_slopes_of_the_log_likelihood(nothing: Fit) -> None:
    fit = nothing.extended(term("constant_bias", {"tau_0": 1e-5}, (), 0.1)).maximise()
    step = 0.2 * float(fit.error[5])
    u = fit.u.copy()
    u[5] += 10.0 * step
    fit = Fit(fit.problem, fit.terms, u)
    fit.error[5] = 5.0 * step
    fit.differentiate()
    u[5] += step
    high = fit.evaluate(u)[0]
    u[5] -= 2.0 * step
    assert fit.scores[:, 5].sum() == pytest.approx((high - fit.evaluate(u)[0]) / (2.0 * step), rel=0.05)


def test_a_fit_climbs_from_a_neutral_start(hidden: Callable[..., Any]) -> None:
    """Steps are of the size of the device's torques, not of one newton metre's."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 4e-4}], 6, SECONDS)
    fit = nominal_fit(problem_of([recording], model)).extended(term("constant_bias", {"tau_0": 0.0}, (), 0.1))
    fit.approach(5, 5).maximise()
    assert float(fit.u[5]) == pytest.approx(4e-4, rel=0.01)


def test_coordinates_stay_within_their_bounds(nothing: Fit) -> None:
    fit = nothing.extended(term("constant_bias", {"tau_0": 1e-4}, (), 0.1))
    u = fit.u.copy()
    u[:] = 1e9
    fit.move(u)
    assert np.all(fit.u <= fit.upper)
    assert np.all(fit.u >= fit.lower)


def test_no_start_breaks_the_filter(nothing: Fit) -> None:
    scale = scale_of(nothing)
    for slug, spec in CATALOGUE.items():
        for values in list(spec.starts(scale))[:2]:
            fit = nothing.extended(term(slug, values, (), 0.1 * scale.travel))
            assert np.isfinite(fit.log_likelihood), slug
            for name in ("mean", "variance", "score", "information", "v"):
                assert np.all(np.isfinite(fit.out[name])), (slug, name)


def test_a_record_without_noise_leaves_nothing_to_vary(
    hidden: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All noise is at its least: no coordinate is free, and the covariance has no row."""
    recording, model = hidden([], 8, 2.0)
    fit = nominal_fit(problem_of([recording], model))
    fit.u = fit.lower.copy()

    def pushed() -> None:
        fit.scores = np.full((fit.out.size, fit.u.size), -1.0)  # all that may move is pushed against its end
        fit.slopes = fit.spreads = np.zeros_like(fit.scores)

    monkeypatch.setattr(fit, "differentiate", pushed)
    assert not covariance_of(fit).any()


def test_of_what_no_sample_tells_little_is_known(nothing: Fit) -> None:
    """No current comes near the limit: its slope is zero, and its interval is not."""
    limit = term("current_saturation", {"i_max": 1e3}, (), 0.1)
    fit = nothing.extended(limit)
    variances = np.diag(covariance_of(fit))
    assert np.all(np.isfinite(variances))
    assert variances[fit.columns(0)] > 100.0


@pytest.mark.parametrize("slug", ["dropped_samples", "backlash", "encoder_eccentricity"])
def test_a_parameter_at_its_bound_has_an_interval(nothing: Fit, slug: str) -> None:
    """It goes on from the bound as far as the data allow, and no farther."""
    fit = nothing.extended(term(slug, next(iter(CATALOGUE[slug].starts(scale_of(nothing)))), (), 0.1))
    first, last = fit.terms[0].coordinates[0], fit.columns(0).start
    fit = fit.replaced(0, fit.terms[0].moved([first.lower, *fit.terms[0].start[1:]]))
    variance = np.diag(covariance_of(fit))[fit.columns(0)]
    found = estimates_of(fit.terms[0], fit.u[fit.columns(0)], variance, fit.problem.series.blocks, False)[first.name]
    ends = np.array([first.lower, first.upper])
    lowest, highest = np.exp(ends) if first.is_log else ends
    assert fit.u[last] == first.lower
    assert found.ci95 is not None
    assert found.ci95[0] == pytest.approx(lowest)
    assert lowest < found.ci95[1] < 0.3 * highest


@pytest.mark.parametrize(
    ("slug", "values", "name", "turns"),
    [
        ("torque_ripple", {"orders": [7.0], "amplitudes": [1e-4], "phases": [9.0]}, "phases[0]", 1),
        ("gravity", {"m_g_l": 1e-4, "theta_0": -40.0}, "theta_0", -6),
        ("return_spring", {"k_s": 1e-4, "theta_0": -40.0}, "theta_0", 0),
    ],
)
def test_an_angle_that_repeats_itself_is_within_a_turn(slug: str, values: Any, name: str, turns: int) -> None:
    law = term(slug, values, ("orders",), 0.1)
    u = np.array(law.start)
    given = {c.name: start for c, start in zip(law.coordinates, law.start, strict=True)}[name]
    found = estimates_of(law, u, np.full(u.size, 1e-4), 40, False)[name]
    assert found.value == pytest.approx(given - 2.0 * np.pi * turns)
    assert np.mean(found.ci95) == pytest.approx(found.value)
    entry = parameters_of_term(law, u)[name.partition("[")[0]]
    assert np.ravel(entry)[0] == pytest.approx(found.value)


def test_terms_climb_in_turn_where_one_would_hold_up_the_others(hidden: Callable[..., Any]) -> None:
    """In a common step the spike of a converter's step had kept a friction two thousandths off, 400 nats below."""
    hiding = [{"name": "dac_quantization", "q": 0.012}, {"name": "coulomb_friction", "r": -0.15}]
    recording, model = hidden(hiding, 2, 10.0)
    start = nominal_fit(problem_of([recording], model))
    for slug, values in (("coulomb_friction", {"r": -0.16}), ("dac_quantization", {"q": 0.012})):
        start = start.extended(term(slug, values, (), 0.1))
    start.scan_power()
    together, in_turn = start.on(start.problem).maximise(), start.on(start.problem)
    in_turn.in_turn(10)
    assert in_turn.log_likelihood > together.log_likelihood + 100.0
    assert float(in_turn.u[in_turn.columns(0)][0]) == pytest.approx(-0.15, abs=1e-4)
    assert float(np.exp(in_turn.u[-1])) == pytest.approx(0.012, rel=1e-5)


def test_a_springy_contact_is_likelier_than_all_that_is_like_it(hidden: Callable[..., Any]) -> None:
    """Of a load that the filter thought it knew, a contact that came early told nothing: 2,700 nats less."""
    play = {"gap": 0.02, "load_share": 0.4, "stiffness": 2.0, "damping": 2e-4}
    recording, model = hidden([{"name": "backlash", **play}], 1, 6.0)
    plain = nominal_fit(problem_of([recording], model))
    rigid = {"gap": 0.02, "load_share": 0.4, "restitution": 0.6}
    coupling = {"f_r": 46.0, "load_share": 0.6, "damping": 0.36}
    fits = [
        plain.extended(term(slug, values, (), 0.1))
        for slug, values in (("backlash", play), ("backlash", rigid), ("flexible_coupling", coupling))
    ]
    for fit in fits:
        fit.scan_power()
    true, *others = [fit.log_likelihood for fit in fits]
    assert true > max(*others, plain.log_likelihood) + 1000.0
    # Slopes tell: a hundred-thousandth of the load's share changes next to nothing.
    u = fits[0].u.copy()
    u[fits[0].columns(0)][1] += 1e-6
    assert abs(fits[0].at(u).log_likelihood - true) < 1.0


def test_what_one_block_alone_knows_is_not_spoilt_by_the_others(hidden: Callable[..., Any]) -> None:
    """A few impacts tell a play: held out, one block had lost 70 nats by what the others said of it.

    Where an impact just misses it still may, and a climb may end beside the top, so the median of six recordings counts.
    """
    losses = []
    for seed in range(1, 7):
        recording, model = hidden([{"name": "backlash", "gap": 0.02, "load_share": 0.4}], seed, 6.0)
        play = term("backlash", {"gap": 0.02, "load_share": 0.4, "restitution": 0.4}, (), 0.1)
        fit = nominal_fit(problem_of([recording], model)).extended(play)
        fit.scan_power()
        fit.maximise()
        losses.append(fit.log_likelihood - float(fit.held_out().sum()))
    assert np.median(np.abs(losses)) < 10.0
    assert min(losses) > -10.0
