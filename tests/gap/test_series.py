"""Recordings as the filter takes them: gaps, several of them, blocks and folds, and a first look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.gap import constants
from hapticd.gap.recording import Recording
from hapticd.gap.series import series_of
from hapticd.plant.layout import device_vector, index_of

from .synthetic import PERIOD, model


def recording(rows: int = 3000, step: float = 1e-3) -> Recording:
    time_s = PERIOD * np.arange(rows)
    position = (np.floor(np.sin(5.0 * time_s) / step) + 0.5) * step if step else np.sin(5.0 * time_s)
    return Recording("made", time_s, position, step, np.cos(5.0 * time_s), None, PERIOD, False)


def without(one: Recording, first: int, last: int) -> Recording:
    keep = np.ones(one.rows, dtype=bool)
    keep[first:last] = False
    return replace(one, time_s=one.time_s[keep], position=one.position[keep], current=one.current[keep])


def test_cells_are_whole_numbers_whose_centres_are_the_positions() -> None:
    one = recording()
    series = series_of([one])
    assert series.cell == pytest.approx(np.rint(series.cell), abs=1e-6)
    assert (series.cell + 0.5) * series.resolution == pytest.approx(one.position)
    assert series.size == 3000
    assert series.duration_s == pytest.approx(2.999)
    assert series.period_s == pytest.approx(PERIOD)


def test_without_a_grid_cells_are_far_below_the_noise() -> None:
    one = recording(step=0.0)
    one = replace(one, position=one.position + 1e-4 * np.random.default_rng(1).normal(size=one.rows))
    series = series_of([one])
    assert 0.0 < series.resolution < 1e-6
    assert (series.cell + 0.5) * series.resolution == pytest.approx(one.position)


def test_a_long_gap_begins_anew_and_a_short_one_does_not() -> None:
    series = series_of([without(without(recording(), 1000, 1030), 2000, 2003)])
    assert np.flatnonzero(series.begins).tolist() == [0, 1000]


def test_recordings_are_put_one_after_the_other() -> None:
    series = series_of([recording(2000), recording(1500)])
    assert series.size == 3500
    assert np.flatnonzero(series.begins).tolist() == [0, 2000]
    assert np.flatnonzero(np.diff(series.recording)).tolist() == [1999]
    assert series.duration_s == pytest.approx(1.999 + 1.499)
    assert not set(series.block[:2000]) & set(series.block[2000:])
    duration, current, _ = series.currents(device_vector(model(), 0.0))
    assert duration.shape == current.shape
    assert duration.sum(axis=1) == pytest.approx(np.full(3500, PERIOD))  # no period from one recording to the next
    assert current[2000, 0] == series.command[2000]


@pytest.mark.parametrize("rows", [2000, 10_000, 20_001, 40_300, 40_800])
def test_blocks_are_enough_and_folds_alike(rows: int) -> None:
    series = series_of([recording(rows)])
    assert series.blocks >= constants.FEWEST_BLOCKS
    assert np.all(np.diff(series.block) >= 0)
    assert np.array_equal(np.unique(series.block), np.arange(series.blocks))
    sizes = np.bincount(series.block)
    assert sizes[:-1].max() - sizes[:-1].min() <= 1
    assert 0.5 < sizes[-1] / sizes[0] < 1.5, "what is left over at the end is no block by itself"
    assert sizes[0] * PERIOD <= constants.BLOCK_S + 1e-9
    held = np.bincount(series.fold)
    assert held.size == constants.FOLDS
    assert held.max() - held.min() <= 1


@pytest.mark.parametrize("rows", [1200, 3000, 7400])
def test_several_recordings_have_blocks_enough(rows: int) -> None:
    series = series_of([recording(rows)] * 6)
    assert series.blocks >= constants.FEWEST_BLOCKS
    sizes = np.bincount(series.block)
    assert sizes.min() > 0.5 * sizes.max()


def test_a_sum_over_blocks_is_the_whole() -> None:
    series = series_of([recording()])
    values = np.random.default_rng(1).normal(size=(series.size, 2))
    assert series.per_block(values).sum(axis=0) == pytest.approx(values.sum(axis=0))
    assert series.per_block(values[:, 0]) == pytest.approx(series.per_block(values)[:, 0])
    assert series.per_block(values[:, 0])[3] == pytest.approx(values[series.block == 3, 0].sum())


def test_a_subsample_has_whole_blocks_of_every_recording() -> None:
    series = series_of([recording(8000), without(recording(8000), 6000, 6500)])
    part = series.subsample(4)
    kept = np.isin(series.block, [2, 7, 8, 13, 18])
    assert np.array_equal(part.cell, series.cell[kept])
    assert np.unique(part.recording).tolist() == [0, 1]
    assert part.per_block(np.ones(part.size)).tolist() == np.bincount(series.block)[[2, 7, 8, 13, 18]].tolist()
    first = np.isin(series.block[kept], [2, 7, 13, 18]) & (np.diff(part.block, prepend=-1) > 0)
    assert np.array_equal(part.begins, first | series.begins[kept])
    assert part.begins.sum() == 4  # block 8 goes on where 7 ends


def test_a_subsample_keeps_no_step_with_what_repeats_itself() -> None:
    series = series_of([recording(64_000)])
    part = series.subsample(4)
    phases = np.bincount((part.time_s // constants.BLOCK_S).astype(int) % 4)
    assert phases.min() > 0.9 * phases.max()


def test_currents_are_of_the_device_asked_for() -> None:
    series = series_of([recording()])
    p = device_vector(model(), 0.0)
    plain = series.currents(p)
    assert plain[1].shape[1] == 1
    assert series.currents(p)[1] is plain[1]
    p[index_of("current_saturation.i_max")] = 0.3
    assert np.abs(series.currents(p)[1]).max() == pytest.approx(0.3)
    p[index_of("transport_delay.t_d")] = 0.4 * PERIOD
    assert series.currents(p)[0][10] == pytest.approx([0.4 * PERIOD, 0.6 * PERIOD])
    p[index_of("dropped_samples.p")] = 0.3
    assert series.currents(p)[2].max() > 0.0


def test_a_slow_amplifier_lags() -> None:
    series = series_of([recording()])
    p = device_vector(model(), 0.0)
    command = series.currents(p)[1][:, 0]
    p[index_of("amplifier_lag.f_a")], p[index_of("amplifier_lag.delta")] = 20.0, 0.7
    duration, current, _ = series.currents(p)
    mean = (duration * current).sum(axis=1) / duration.sum(axis=1)
    lag = 2.0 * 0.7 / (2.0 * np.pi * 20.0)
    expected = np.interp(series.time_s - lag, series.time_s, command)
    assert mean[500:] == pytest.approx(expected[500:], abs=0.01)


def test_no_recording_is_an_error() -> None:
    with pytest.raises(ValueError, match="no recording"):
        series_of([])


@pytest.mark.parametrize("every", range(2, 11))
def test_what_comes_again_after_a_few_blocks_is_in_most_folds(every: int) -> None:
    fold = series_of([recording(60_000)]).fold
    assert fold.size == 60
    assert np.all(np.diff(fold) != 0)
    for first in range(every):
        again = np.bincount(fold[first::every])
        assert again.max() <= 0.6 * again.sum()
