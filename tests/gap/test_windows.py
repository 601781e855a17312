"""Windows, blocks, folds, and ticks cut where the current switches."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.gap.predict import split_at_switching
from hapticd.gap.windows import cut, folds, thinned, window_length


def test_windows_do_not_overlap_and_stay_inside() -> None:
    windows = cut(2000, 1e-3, 40, skip=5)
    rows = windows.rows
    assert rows.shape == (49, 40)
    assert len(np.unique(rows)) == rows.size
    assert rows.min() == 6
    assert rows.max() <= 1999


def test_blocks_last_a_second_and_every_fold_spans_the_recording() -> None:
    windows = cut(20_000, 1e-3, 40)
    assert np.bincount(windows.block)[0] == 25
    for fold in range(5):
        mine = windows.start[folds(windows.block) == fold]
        assert mine.max() - mine.min() > 14_000


def test_a_third_of_the_windows_and_the_worst() -> None:
    square = np.ones(600)
    square[[40, 41, 300]] = 50.0
    mask = thinned(0.03, square)
    assert mask[[40, 41, 300]].all()
    assert mask.sum() == pytest.approx(200, abs=20)
    square[:] = 50.0
    assert thinned(0.03, square).sum() <= 200 + 20 + 30


def test_a_heavier_or_coarser_device_gets_longer_windows() -> None:
    light = window_length(1e-3, 6.28e-6, 2e-3, 2.2e-4, 20_000)
    assert window_length(1e-3, 6.28e-5, 2e-3, 2.2e-4, 20_000) > light
    assert window_length(1e-3, 6.28e-6, 2e-3, 2.2e-3, 20_000) > light
    assert window_length(1e-3, 6.28e-6, 2e-3, 1e-9, 20_000) == 30


@pytest.mark.parametrize("delay", [7.4e-5, 1.3e-3])
def test_a_tick_is_cut_where_a_delayed_command_takes_effect(delay: float) -> None:
    time = np.cumsum(1e-3 + 1e-5 * np.random.default_rng(0).random(50))
    split = split_at_switching(time, delay)
    assert np.all(np.diff(split) > 0.0)
    np.testing.assert_array_equal(split[::2], time)
    late = split[1::2][5:-5]
    assert np.min(np.abs(late[:, None] - (time + delay)[None, :]), axis=1).max() < 1e-12
