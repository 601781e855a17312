"""The compiled device: amplifier delay and its queue, time, encoder, converter and hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.config import load_config
from hapticd.plant import kernel
from hapticd.plant.exact import propagate
from hapticd.plant.spring import propagate_with_stiffness
from tests.plant.reference import device_config

MS = 1_000_000
J, B, C, KT = 6.28e-6, 9.0e-6, 2.0e-3, 0.0292

Block = tuple[NDArray[np.float64], NDArray[np.int64]]


def block(position: float = 0.0, velocity: float = 0.0, **changes: Any) -> Block:
    f = kernel.init_plant(device_config(**changes), position, velocity)  # type: ignore[arg-type]
    return f, f.view(np.int64)


def state(f: NDArray[np.float64]) -> tuple[float, float]:
    return float(f[kernel.POSITION]), float(f[kernel.VELOCITY])


def test_a_real_config_fills_the_block() -> None:
    f = kernel.init_plant(load_config(None), 0.5, -2.0)
    assert f.shape == (kernel.PLANT_SIZE,)
    assert state(f) == (0.5, -2.0)
    assert f[kernel.LAG_NS] == pytest.approx(1e9 * 2 * 0.7 / (2 * math.pi * 3000), rel=1e-14)
    assert f[kernel.DAC_STEP] == 12.0 / 2**14
    assert f.view(np.int64)[kernel.DAC_MAX_CODE] == 8191
    assert f[kernel.SATURATION] == 6.0


def test_a_period_is_the_exact_step_to_the_bit() -> None:
    f, i = block(0.1, 20.0)
    kernel.plant_command(f, i, 0, 0.0, 0.7)
    kernel.plant_advance(f, i, MS, 0.0)
    assert state(f) == propagate(0.1, 20.0, 0.001, 0.7 * KT, J, B, C)


def test_the_hand_adds_its_inertia_damping_force_and_spring() -> None:
    f, i = block(0.1, 20.0, hand__inertia=1e-6, hand__damping=1e-5, hand__stiffness=0.05, origin_counts=100)
    rest = 100 * 2 * math.pi / 8192
    f[kernel.HAND_FORCE] = -0.004
    kernel.plant_command(f, i, 0, 0.0, 0.7)
    kernel.plant_advance(f, i, 5 * MS, 0.0)
    x, v = propagate_with_stiffness(0.1 - rest, 20.0, 0.005, 0.7 * KT - 0.004, J + 1e-6, B + 1e-5, C, 0.05)
    assert state(f) == (x + rest, v)


def test_stiction_under_a_hand_s_spring_moves_nothing_by_a_bit() -> None:
    for position in np.random.default_rng(4).normal(0.1, 0.01, 200):
        f, i = block(position, hand__stiffness=1e-3, origin_counts=33)
        kernel.plant_advance(f, i, MS, 0.0)
        assert state(f) == (position, 0.0)


def test_an_instant_that_is_not_ahead_changes_nothing() -> None:
    f, i = block(0.1, 20.0)
    kernel.plant_command(f, i, 0, 0.0, 0.7)
    kernel.plant_advance(f, i, MS, 0.25)
    before = f.tobytes()
    for ns, frac in [(MS, 0.25), (MS, 0.0), (MS - 1, 0.999), (0, 0.0), (-5 * MS, 0.0)]:
        kernel.plant_advance(f, i, ns, frac)
        assert f.tobytes() == before


@pytest.mark.parametrize("delay", [0.3e-3, 1e-3, 2.75e-3])
def test_a_current_takes_effect_after_the_amplifier_delay(delay: float) -> None:
    f, i = block(amplifier__delay=delay)
    currents = [1.0, -0.5, 0.25, 0.0, 0.75, -1.0]
    for k, current in enumerate(currents):
        kernel.plant_advance(f, i, k * MS, 0.0)
        kernel.plant_command(f, i, k * MS, 0.0, current)
    kernel.plant_advance(f, i, 10 * MS, 0.0)

    x, v = propagate(0.0, 0.0, delay, 0.0, J, B, C)
    for current in currents[:-1]:
        x, v = propagate(x, v, 1e-3, current * KT, J, B, C)
    x, v = propagate(x, v, 10e-3 - delay - 5e-3, currents[-1] * KT, J, B, C)
    assert state(f) == pytest.approx((x, v), rel=1e-12)


def test_the_motion_does_not_depend_on_when_it_is_looked_at() -> None:
    random = np.random.default_rng(1)
    often, often_i = block(0.1, 20.0, amplifier__delay=0.37e-3)
    once, once_i = block(0.1, 20.0, amplifier__delay=0.37e-3)
    for k in range(40):
        current = random.normal()
        kernel.plant_command(once, once_i, k * MS, 0.5, current)
        for part in sorted(random.integers(0, MS, 5)):
            kernel.plant_advance(often, often_i, (k - 1) * MS + part, 0.5)
        kernel.plant_command(often, often_i, k * MS, 0.5, current)
    kernel.plant_advance(often, often_i, 50 * MS, 0.0)
    kernel.plant_advance(once, once_i, 50 * MS, 0.0)
    assert state(often) == pytest.approx(state(once), rel=1e-11)


def test_a_current_due_at_an_instant_is_in_the_motor_at_that_instant() -> None:
    f, i = block(amplifier__delay=2e-3)
    kernel.plant_command(f, i, 0, 0.5, 0.7)
    kernel.plant_advance(f, i, 2 * MS, 0.49)
    assert f[kernel.CURRENT] == 0.0
    kernel.plant_advance(f, i, 2 * MS, 0.5)
    assert f[kernel.CURRENT] == 0.7
    assert state(f) == (0.0, 0.0)


def test_a_command_from_the_past_takes_effect_at_once_and_in_order() -> None:
    f, i = block(amplifier__delay=1e-3)
    kernel.plant_advance(f, i, 10 * MS, 0.0)
    kernel.plant_command(f, i, 2 * MS, 0.0, 0.4)
    kernel.plant_command(f, i, 3 * MS, 0.0, 0.7)
    kernel.plant_advance(f, i, 11 * MS, 0.0)
    assert state(f) == propagate(0.0, 0.0, 0.001, 0.7 * KT, J, B, C)


def test_the_queue_holds_4096_commands_and_counts_what_it_cannot_hold() -> None:
    f, i = block(amplifier__delay=10.0)
    for k in range(kernel.QUEUE_LENGTH):
        kernel.plant_command(f, i, k * 1000, 0.0, 1e-4 * k)
    assert i[kernel.QUEUE_OVERFLOWS] == 0
    kernel.plant_command(f, i, 5 * MS, 0.0, 0.123)
    assert i[kernel.QUEUE_OVERFLOWS] == 1
    kernel.plant_advance(f, i, 10_000_000_000 + 4_000_000, 0.0)
    assert f[kernel.CURRENT] == pytest.approx(1e-4 * 4000)
    kernel.plant_advance(f, i, 10_000_000_000 + 5 * MS, 0.0)
    assert f[kernel.CURRENT] == 0.123
    assert i[kernel.QUEUE_HEAD] == i[kernel.QUEUE_TAIL]


def test_the_queue_goes_round_without_losing_a_command() -> None:
    f, i = block(amplifier__delay=3.5e-3)
    for k in range(3 * kernel.QUEUE_LENGTH):
        kernel.plant_advance(f, i, k * MS, 0.0)
        assert f[kernel.CURRENT] == (0.0 if k < 4 else 1e-6 * (k - 4))
        kernel.plant_command(f, i, k * MS, 0.0, 1e-6 * k)
    assert i[kernel.QUEUE_OVERFLOWS] == 0


def test_a_third_of_a_millisecond_does_not_drift() -> None:
    f, i = block(0.0, 1.0, plant__viscous=0.0, plant__coulomb=0.0)
    for thirds in range(1_000_000, 1_000_001_000_000, 1_000_000):
        ns, rest = divmod(thirds, 3)
        kernel.plant_advance(f, i, ns, rest / 3)
    # At 1 rad/s: whole nanoseconds would be 10⁻⁶ off; what is left is the rounding of 10⁶ sums of positions.
    assert f[kernel.POSITION] == pytest.approx(1000.0 / 3.0, rel=1e-10)
    assert (i[kernel.TIME_NS], f[kernel.TIME_FRAC]) == (333_333_333_333, 1 / 3)


def test_a_long_running_clock_loses_nothing() -> None:
    start = 2**62
    f, i = block(0.1, 20.0)
    i[kernel.TIME_NS], f[kernel.TIME_FRAC] = start, 0.75
    kernel.plant_advance(f, i, start + MS, 0.75)
    assert state(f) == propagate(0.1, 20.0, 0.001, 0.0, J, B, C)


@pytest.mark.parametrize(
    ("position", "counts"), [(0.0, 0), (0.99, 0), (1.0, 1), (2.5, 2), (-0.01, -1), (-1.0, -1), (-1.01, -2), (-2.5, -3)]
)
@pytest.mark.parametrize("invert", [False, True])
def test_the_encoder_floors_and_an_inverted_one_is_its_mirror(position: float, counts: int, invert: bool) -> None:
    f, i = block(position, raw_resolution=1.0, encoder__invert=invert)
    assert kernel.plant_counts(f, i) == (-counts if invert else counts)


@pytest.mark.parametrize(("position", "counts"), [(math.inf, 2**62), (-1e300, -(2**62)), (math.nan, -(2**62))])
def test_the_count_ends_where_integers_do(position: float, counts: int) -> None:
    f, i = block(position, raw_resolution=1.0)
    assert kernel.plant_counts(f, i) == counts


@pytest.mark.parametrize(
    ("bits", "peak", "command", "current"),
    [
        (14, None, 1.0, 1365 * 12 / 2**14),
        (14, None, 9.0, 8191 * 12 / 2**14),
        (14, None, -9.0, -6.0),
        (14, 2.5, 9.0, 2.5),
        (14, 2.5, -9.0, -2.5),
        (14, 6.0, 1365 * 12 / 2**14, 1365 * 12 / 2**14),
        (0, 2.5, 9.0, 2.5),
        (0, None, 9.0, 9.0),
        (0, None, 1 / 3, 1 / 3),
        (0, 2.5, math.nan, 0.0),
        (14, 2.5, math.nan, 0.0),
        (0, 2.5, -math.inf, -2.5),
    ],
)
def test_converter_and_saturation(bits: int, peak: float | None, command: float, current: float) -> None:
    f, i = block(amplifier__dac_bits=bits, amplifier__peak_current=peak)
    kernel.plant_command(f, i, 0, 0.0, command)
    assert f[kernel.CURRENT] == current


def test_it_stays_when_stiction_carries_what_pulls_on_it() -> None:
    f, i = block(0.1)
    assert kernel.plant_stays(f, i)
    f[kernel.HAND_FORCE] = C * 1.01
    assert not kernel.plant_stays(f, i)
    kernel.plant_command(f, i, 0, 0.0, -C / KT)
    assert kernel.plant_stays(f, i)
    f[kernel.VELOCITY] = 1e-9
    assert not kernel.plant_stays(f, i)
