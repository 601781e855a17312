"""Every excitation, played through the loop on the simulated testbed with all trips armed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from drivers.loopback import LoopbackDriver
from hapticd.config import load_config
from hapticd.record.schema import FLAG_EXCITATION
from hapticd.servo import atomics, excitation
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from tests.servo.scripted import config, fault_code


@pytest.mark.parametrize("name", [*excitation.SHAPES, excitation.ALL])
def test_shape_moves_the_shaft_both_ways_within_every_limit(name: str) -> None:
    cfg = load_config("re35")
    table = excitation.build(cfg, name)
    driver = LoopbackDriver(cfg)
    driver.open()
    core = ServoCore(driver, ring_rows=1 << 18, excitation_rows=table.shape[1])
    core.excitation[:] = table
    core.publish(parameters(cfg, Request(state=w.RUNNING, excitation_id=1, excitation_length=table.shape[1])))
    core.begin(0)
    core.run(real_time=False, ticks=table.shape[1] + 100)
    rows = core.drain()
    assert fault_code(core) is None
    assert core.load(atomics.EXCITATION_DONE) == 1
    assert (rows["flags"] & FLAG_EXCITATION != 0).sum() == table.shape[1]
    velocity = np.diff(rows["encoder_counts"])
    assert velocity.max() > 0 > velocity.min()
    assert rows["encoder_counts"].max() > 50
    assert rows["encoder_counts"].min() < -50
    assert core.load(atomics.CLAMPED) == 0
    assert np.abs(rows["current_command_A"]).max() < (cfg.amplifier.continuous_current or np.inf)


def test_sweep_travels_at_five_constant_speeds_there_and_back() -> None:
    cfg = config()
    origin = excitation.build(cfg, "sweep", amplitude=0.5, duration_s=10.0)[1]
    speeds = np.diff(origin) * cfg.raw_resolution * cfg.servo.rate_hz
    for block, cycles in zip(np.array_split(speeds, 5), (1, 2, 3, 5, 8), strict=True):
        expected = 4 * 0.5 * cycles / 2.0
        assert np.median(np.convolve(np.abs(block), np.ones(50) / 50, "valid")) == pytest.approx(expected, rel=0.05)
        assert block.mean() == pytest.approx(0.0, abs=0.02 * expected)
    assert origin.max() == pytest.approx(0.5 / cfg.raw_resolution, abs=1)


def test_chirp_keeps_to_the_band_that_is_asked_for() -> None:
    rate_hz = config().servo.rate_hz
    current = excitation.build(config(), "chirp", duration_s=10.0, low_hz=30.0, high_hz=200.0)[0]
    power = np.abs(np.fft.rfft(current)) ** 2
    frequency = np.fft.rfftfreq(len(current), 1 / rate_hz)
    inside = (frequency > 28.0) & (frequency < 210.0)
    assert power[inside].sum() > 0.98 * power.sum()
    for part in ((30.0, 60.0), (100.0, 200.0)):
        assert power[(frequency > part[0]) & (frequency < part[1])].sum() > 0.2 * power.sum()


def test_chirp_rises_from_low_to_high_frequency() -> None:
    current = excitation.build(config(), "chirp", amplitude=1.0, duration_s=20.0)[0]
    crossings = np.flatnonzero(np.diff(np.sign(current)) != 0)
    assert 0.4 < 500 / (crossings[2] - crossings[1]) < 1.2
    assert 30 < 500 / (crossings[-1] - crossings[-2]) <= 42
    assert all(later <= earlier * 1.1 + 2 for earlier, later in pairwise(np.diff(crossings)[1:]))


def test_steps_push_as_much_to_one_side_as_to_the_other_and_are_seeded() -> None:
    first = excitation.build(config(), "steps", seed=3)
    assert first[0].mean() == pytest.approx(0.0, abs=1e-3 * first[0].max())
    assert (first == excitation.build(config(), "steps", seed=3)).all()
    assert (first != excitation.build(config(), "steps", seed=4)).any()


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("chrip", {}, "excitation 'chrip' is unknown (known: ramp, sweep, chirp, steps, release, all)"),
        ("chirp", {"amplitude": 2.5}, "chirp: amplitude = 2.5: must be at most 2 A (amplifier.continuous_current)"),
        ("release", {"amplitude": 7.0}, "release: amplitude = 7: must be at most 5 rad (half of safety.max_excursion)"),
        ("ramp", {"amplitude": 0.0}, "ramp: amplitude = 0: must be above 0 A"),
        ("ramp", {"amplitude": float("nan")}, "ramp: amplitude = nan: must be above 0 A"),
        ("steps", {"duration_s": 0.1}, "steps: duration = 0.1: must be between 0.5 and 600 s"),
        ("all", {"amplitude": 1.0}, "all: takes no amplitude; give one excitation to set it"),
        ("steps", {"high_hz": 50.0}, "steps: takes no high_hz; it has no frequency range"),
        ("chirp", {"low_hz": 9.0, "high_hz": 9.0}, "chirp: low_hz = 9: must be above 0 Hz and below high_hz = 9 Hz"),
        (
            "chirp",
            {"high_hz": 251.0},
            "chirp: high_hz = 251: must be at most 250 Hz (4 samples per period at servo.rate_hz)",
        ),
        (
            "sweep",
            {"amplitude": 5.0, "duration_s": 1.0},
            "sweep: the origin would move at 800.7 rad/s: must be at most 200 rad/s (half of safety.max_velocity); "
            "make the amplitude smaller or the duration longer",
        ),
    ],
)
def test_what_a_limit_does_not_admit_is_refused(name: str, options: dict[str, float], message: str) -> None:
    with pytest.raises(excitation.ExcitationError) as refused:
        excitation.build(config(), name, **options)  # type: ignore[arg-type]
    assert str(refused.value) == message
