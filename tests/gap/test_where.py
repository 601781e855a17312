"""A residual that was put somewhere is found there, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.gap.data import Recording
from hapticd.gap.smooth import motion_of
from hapticd.gap.where import bin_edges, coordinates_at, map_residual

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def coordinates(nominal_run: Recording) -> dict[str, Floats]:
    times = np.linspace(0.5, 19.5, 1500)
    late = Recording(**{**nominal_run.__dict__, "lateness_s": np.abs(np.sin(37.0 * nominal_run.time_s)) * 1e-5})
    return coordinates_at(late, motion_of(nominal_run), times)


def _noise(size: int) -> Floats:
    return np.random.default_rng(7).normal(size=size)


def test_every_coordinate_is_there(coordinates: dict[str, Floats]) -> None:
    expected = "time position velocity speed direction acceleration current current_rate since_reversal lateness"
    assert set(coordinates) == set(expected.split())
    assert all(np.isfinite(values).all() for values in coordinates.values())


def test_slow_motion_is_named_with_its_speed_and_both_directions(
    coordinates: dict[str, Floats],
) -> None:
    speed = coordinates["speed"]
    limit = float(np.quantile(speed, 0.25))
    residual = _noise(speed.size) * np.where(speed < limit, 1.0, 0.1)
    place = next(p for p in map_residual(residual, coordinates) if p.coordinate == "speed")
    assert place.significant
    assert place.range[0] is None
    assert place.range[1] == pytest.approx(limit, rel=0.1)
    assert place.share == pytest.approx(0.97, abs=0.03)
    assert place.words.startswith("9")
    assert place.words.endswith("rad/s, in both directions")


def test_a_push_along_the_angle_is_explained_by_position_first(
    coordinates: dict[str, Floats],
) -> None:
    residual = coordinates["position"] + 0.2 * _noise(1500)
    places = map_residual(residual, coordinates, is_linear=True)
    assert places[0].coordinate == "position"
    assert places[0].explained > 0.8
    assert places[0].unit == "m"


def test_noise_is_nowhere(coordinates: dict[str, Floats]) -> None:
    places = map_residual(_noise(1500), coordinates)
    assert sum(place.significant for place in places) <= 1
    assert all(place.explained < 0.05 for place in places)


def test_known_noise_is_not_disagreement(coordinates: dict[str, Floats]) -> None:
    late = coordinates["time"] > 15.0
    residual = _noise(1500) * np.where(late, 2.0, 1.0)
    with_noise = next(p for p in map_residual(residual, coordinates, noise=1.0) if p.coordinate == "time")
    without = next(p for p in map_residual(residual, coordinates) if p.coordinate == "time")
    assert with_noise.share > without.share + 0.2
    assert with_noise.range[0] == pytest.approx(15.0, abs=1.0)


def test_json_has_the_keys_of_the_interface(
    coordinates: dict[str, Floats],
) -> None:
    entry = map_residual(_noise(1500), coordinates)[0].to_json()
    assert {"coordinate", "range", "share"} <= set(entry)
    assert len(entry["range"]) == 2


def test_bins_hold_equally_many_rows_and_repeat_nothing() -> None:
    edges = bin_edges(np.random.default_rng(1).normal(size=1200))
    assert edges.size == 13
    assert bin_edges(np.array([-1.0, -1.0, 1.0, 1.0])).tolist() == [-1.0, 0.0, 1.0]


def test_few_residuals_are_refused(coordinates: dict[str, Floats]) -> None:
    with pytest.raises(ValueError, match="20 residuals are too few"):
        map_residual(_noise(20), {name: values[:20] for name, values in coordinates.items()})
