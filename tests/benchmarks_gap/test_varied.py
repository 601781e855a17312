"""The benchmark of other devices and excitations: what it draws, what it plays, and how it counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gap import devices, tasks, varied
from benchmarks.gap.hidden import LAWS
from hapticd.config import parse_config


def test_thirty_seeds_have_every_effect_once_and_nothing_in_every_fifth() -> None:
    cases = [varied.drawn(seed).case for seed in range(30)]
    assert sorted(case.slugs[0] for case in cases if case.slugs) == sorted(LAWS)
    assert [case.seed for case in cases if not case.slugs] == [0, 5, 10, 15, 20, 25]


def test_a_seed_is_the_same_case_again_and_the_plan_s_devices_stay_as_they_are() -> None:
    before = devices.model("re35")
    assert varied.drawn(7) == varied.drawn(7)
    assert varied.drawn(7).nominal["plant"] != varied.drawn(31).nominal["plant"]
    assert devices.model("re35") == before
    for seed in range(30):
        parse_config(varied.drawn(seed).nominal, "nominal")


@pytest.mark.parametrize("kind", varied.KINDS)
def test_a_session_moves_the_device_and_keeps_to_its_limits(kind: str) -> None:
    nominal = devices.model("heavy")
    found = varied.play(kind, nominal, 2.0, np.random.default_rng(1), 1.0, 1.0)
    assert found.times.shape == found.extra.shape == found.origin.shape == (2000,)
    assert np.all(np.diff(found.times) > 0.0)
    assert np.abs(found.extra).max() <= 0.8 * nominal["amplifier"]["continuous_current"]
    assert np.ptp(found.extra) > 0.0 or np.ptp(found.origin) > 300.0


def test_a_case_is_recorded_with_its_own_device() -> None:
    one = varied.drawn(2)
    files, _ = tasks.make(replace(one.case, duration_s=2.0), one.lab)
    assert f"rate_hz: {one.nominal['servo']['rate_hz']}".encode() in files["model.yaml"]


def test_what_is_counted() -> None:
    def told(verdict: str, *effects: str) -> tasks.Answer:
        return {"verdict": verdict, "effects": list(effects), "steps": [], "processor_s": 1.0}

    found = [
        (varied.drawn(1), 1.0, told("effect_found", varied.drawn(1).case.slugs[0], "gravity")),
        (varied.drawn(2), 1.0, told("effect_found", "dac_quantization")),
        (varied.drawn(3), 1.0, {"error": "Traceback\nValueError: why", "processor_s": 1.0}),
        (varied.drawn(4), 0.0, {"error": "no session"}),
        (varied.drawn(0), 0.0, told("unexplained")),
    ]
    assert {name: value.partition("(")[2].partition(";")[0] for name, value in varied.rates(found)} == {
        "first name": "1/3",
        "confidently wrong": "1/3",
        "wrong further names": "1/3",
        "nothing hidden: any other answer": "1/1",
        "no answer": "1/4",
    }
