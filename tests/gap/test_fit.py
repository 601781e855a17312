"""Fits of initial states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.gap.fit import fit_states
from hapticd.gap.hypothesis import Hypothesis
from hapticd.gap.prepare import prepare
from hapticd.plant.layout import THETA, device_vector

if TYPE_CHECKING:
    from collections.abc import Callable


def test_every_window_finds_back_from_another_position(hidden: Callable[..., Any]) -> None:
    """What the velocity of a shaft about to slip does is known to no first order; its position alone must do."""
    recording, model = hidden([], 7, 12.0)
    base = Hypothesis(device_vector(model))
    segments = prepare([recording], base).segments
    there = fit_states(segments, base, np.zeros(0), [s.first_states() for s in segments])[0]
    moved = [segment.first_states() for segment in segments]
    for segment, state in zip(segments, moved, strict=True):
        state[:, THETA] -= 60.0 * segment.sigma
    back = fit_states(segments, base, np.zeros(0), moved)[0]
    good = there.mean_square < 3.0
    assert good.mean() > 0.7
    assert back.mean_square[good].max() < 30.0
