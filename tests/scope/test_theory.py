"""What the page is told of theory is what `hapticd.stability` says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hapticd.config import ConfigError, apply_settings, load_config
from hapticd.scope import theory
from hapticd.stability.assessment import assess
from hapticd.stability.criterion import criterion_margin
from hapticd.stability.numbers import from_config
from hapticd.stability.report import number
from hapticd.stability.storage import velocity_bound

CASES = [
    {},
    {"encoder.decimation": 217, "servo.rate_hz": 500},
    {"encoder.decimation": 217, "servo.rate_hz": 100},
    {"encoder.decimation": 217, "delay.computation_s": 0.002},
    {"encoder.decimation": 1000},
]


@pytest.mark.parametrize("settings", CASES)
@pytest.mark.parametrize("deflection", [2.3, 20.3])
def test_the_point_is_checks(settings: dict[str, float], deflection: float) -> None:
    config = apply_settings(load_config(None), settings)
    point = theory.plane(config, deflection)["point"]
    expected = assess(config, deflection=deflection)
    assert point["region_here"] == expected.region
    assert point["region"] == assess(config).region
    assert (point["beta"], point["sigma"]) == (expected.numbers.beta, expected.numbers.sigma)
    assert point["velocity_limit"]["ticks_per_period"] == expected.velocity_limit


@pytest.mark.parametrize("settings", CASES)
def test_on_a_boundary_the_margin_is_zero(settings: dict[str, float]) -> None:
    config = apply_settings(load_config(None), settings)
    found = theory.plane(config, 5.3)
    n = from_config(config)
    top = float(velocity_bound(5.3, 0.0, n.mu, n.tau_d, n.kappa))
    checked = 0
    for beta, sigma in zip(found["beta"], found["paper"], strict=True):
        if math.isfinite(sigma):
            margin = criterion_margin(replace(n, beta=beta, sigma=sigma), top)
            assert margin == pytest.approx(0, abs=1e-3 * max(1.0, sigma))
            checked += 1
    assert checked > 50


def test_the_drivers_latency_is_part_of_the_delay() -> None:
    document = load_config(None).model_dump(mode="json")
    found = theory.describe(document, 0.002)["plane"]["point"]["tau_d"]
    assert found == pytest.approx(from_config(load_config(None), 0.002).tau_d)
    assert found == pytest.approx(theory.describe(document)["plane"]["point"]["tau_d"] + 2)


def test_a_preview_changes_nothing_and_refuses_what_the_daemon_would() -> None:
    document = load_config(None).model_dump(mode="json")
    before = str(document)
    found = theory.preview(document, {"encoder.decimation": 217}, 10.3, 0.0)
    assert found["point"]["sigma"] == pytest.approx(theory.plane(load_config(None))["point"]["sigma"] / 217)
    assert str(document) == before
    with pytest.raises(ConfigError, match=r"spring\.stiffness"):
        theory.preview(document, {"spring.stiffness": -1}, 10.3, 0.0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"spring.stiffness": 0}, "no spring"),
        ({"amplifier.bandwidth_hz": 0, "amplifier.dac_bits": 0}, "rest 100 %, proven"),
        ({"encoder.decimation": 1000}, "periods"),
        ({"encoder.decimation": 217, "servo.rate_hz": 100, "amplifier.bandwidth_hz": 0}, "rest"),
    ],
)
def test_what_starts_end_in_is_what_check_explores(settings: dict[str, float], words: str) -> None:
    config = apply_settings(load_config(None), settings)
    found = theory.ends(config.model_dump(mode="json"))
    assert words in found["words"]
    explored = assess(config).explored
    assert (explored is None) == (found["starts"] == 0)
    if explored is not None:
        assert 64 <= found["starts"] <= theory.EFFORT.starts
        fewer = assess(config, effort=theory.EFFORT).explored
        assert fewer is not None
        share, name, _ = fewer.ends[0]
        assert found["words"].startswith(f"{name} {100.0 * share:.2g} %")
        assert found["words"].endswith(f"largest ±{number(fewer.largest_cycle, 2)} ticks")


def test_without_a_spring_there_is_no_boundary() -> None:
    found = theory.plane(apply_settings(load_config(None), {"spring.stiffness": 0}))
    assert np.isinf(found["point"]["sigma"])
    assert found["paper"] == []
