"""Probabilities of stability under uncertain parameters, against closed forms where there are any."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from hapticd.config import ConfigError, parse_config
from hapticd.stability.assessment import assess
from hapticd.stability.criterion import lambda_
from hapticd.stability.figures.check import check_figure
from hapticd.stability.tuning import stiffness_max_passive
from hapticd.stability.uncertainty import Confidence, confidence


def sure(uncertainty: dict[str, Any], K: float = 0.014, **motion: float) -> Confidence:
    config = parse_config({"spring": {"stiffness": K}, "plant": {"uncertainty": uncertainty}}, "test")
    found = confidence(assess(config, **motion))
    assert found is not None
    return found


def test_nothing_uncertain_nothing_said() -> None:
    assert confidence(assess(parse_config({}, "certain"))) is None


def test_viscous_friction_alone_is_a_log_normal() -> None:
    """Stable if b ≥ K (T/2 + T_D), passive if b ≥ KTλ, which are bounds on a normal."""
    b, s = 9e-6, 1.5e-6
    config = parse_config({"spring": {"stiffness": 0.014}}, "test")
    loop = assess(config).loop
    bound = loop.stiffness * (0.5 * loop.period + loop.delay)
    found = sure({"viscous": s})
    assert found.stable == pytest.approx(float(norm.sf(np.log(bound / b) / (s / b))), abs=5e-3)
    assert found.decides == "viscous"
    quantile = b * np.exp(norm.ppf(0.05) * s / b)
    assert found.stiffness_max == pytest.approx(quantile / (loop.period * float(lambda_(loop.numbers.tau_d))), rel=5e-3)


def test_without_much_uncertainty_the_largest_stiffness_is_that_of_the_config() -> None:
    config = parse_config({"spring": {"stiffness": 0.014}}, "test")
    assert sure({"viscous": 1e-12}).stiffness_max == pytest.approx(stiffness_max_passive(assess(config).loop), rel=1e-5)


def test_the_delay_decides_where_it_alone_is_unknown() -> None:
    found = sure({"delay_s": 5e-5})
    assert found.decides == "delay"
    assert 0.5 < found.stable < 1.0


def test_a_spring_has_a_probability_to_be_passive() -> None:
    found = sure({"viscous": 1.5e-6}, deflection=10.0)
    assert 0.0 < found.passive < found.stable
    # which is of every motion
    assert sure({"viscous": 1.5e-6}).passive == found.passive


def test_correlated_errors_count() -> None:
    alone = sure({"viscous": 1.5e-6, "delay_s": 8e-5})
    together = sure({"viscous": 1.5e-6, "delay_s": 8e-5, "correlation": {"viscous_delay": 0.95}})
    against = sure({"viscous": 1.5e-6, "delay_s": 8e-5, "correlation": {"viscous_delay": -0.95}})
    assert together.stiffness_max > alone.stiffness_max > against.stiffness_max


def test_with_virtual_damping_the_exact_loop_and_the_passivity_bound_are_asked() -> None:
    """b > K(T/2 + T_D) + B is closed; twice that damping buzzes or grows in no draw of so narrow an uncertainty."""
    B, s = 2e-6, 1e-6
    data = {"spring": {"stiffness": 0.01, "damping": B}, "plant": {"uncertainty": {"viscous": s}}}
    found = assess(parse_config(data, "damped"), deflection=10.0)
    sure = confidence(found)
    assert sure is not None
    assert found.damped is not None
    b = found.config.plant.viscous
    assert sure.passive == pytest.approx(float(norm.sf(np.log(found.damped.passive_least / b) / (s / b))), abs=0.02)
    assert sure.stiffness_max is None
    assert sure.stable >= 0.99


def test_impossible_correlations_are_refused() -> None:
    correlation = {"inertia_viscous": 0.9, "inertia_coulomb": 0.9, "viscous_coulomb": -0.9}
    with pytest.raises(ConfigError, match="this is no correlation matrix"):
        parse_config({"plant": {"uncertainty": {"correlation": correlation}}}, "test")


def test_the_figure_shows_the_cloud(tmp_path: Path) -> None:
    config = parse_config({"plant": {"uncertainty": {"viscous": 1e-6, "coulomb": 1e-4}}}, "test")
    found = assess(config)
    check_figure(found, [], tmp_path / "plane.svg", "rig", confidence(found))
    check_figure(found, [], tmp_path / "bare.svg", "rig")
    assert (tmp_path / "plane.svg").stat().st_size > 1.5 * (tmp_path / "bare.svg").stat().st_size
