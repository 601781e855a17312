"""Where simulation and measurement disagree: a residual laid over time, position, velocity and what else was going on.

Any residual will do that has a time: the missing torque of `force`, or a residual torque a window of the multi-step
prediction. Two questions are asked of every coordinate. How much of the disagreement sits in which range of it, above
what the time spent there would give; and how much of the residual its bins' means predict on blocks they were not formed
on. Both are held against chance: the same with the residual shifted along the record, which keeps its autocorrelation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.gap.regression import Blocks
from hapticd.gap.smooth import Motion, held_mean, velocity_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.data import Recording

    FloatArray = NDArray[np.float64]

BINS = 12
_SHIFTS = 200
_CHANCE = 0.995
"""Quantile of the shifted residuals: with a dozen coordinates, one in twenty maps shows something that is not there."""
_BOTH = 0.3
"""Each direction holds at least this share of what a range holds: both do."""
_ROTARY = {"position": "rad", "velocity": "rad/s", "speed": "rad/s", "acceleration": "rad/s²"}
_LINEAR = {"position": "m", "velocity": "m/s", "speed": "m/s", "acceleration": "m/s²"}
_UNITS = {"time": "s", "direction": "", "current": "A", "current_rate": "A/s", "since_reversal": "s", "lateness": "s"}
_NAMES = {
    "current_rate": "current rate",
    "since_reversal": "a time since the last reversal",
    "lateness": "tick lateness",
}


@dataclass(frozen=True)
class Place:
    """Where along one coordinate the disagreement sits.

    Attributes:
        coordinate: its name. unit: its unit.
        range: (low, high) of the bins in which the disagreement is denser than in time; None where a side is open.
        share: part of the squared residual in excess of noise inside the range. time_share: part of the rows there.
        chance: the difference share − time_share that chance reaches in one of 200 maps.
        explained: part of the squared residual that the bins' means predict on other blocks; below 0 is nothing.
        explained_chance: the part that chance reaches in one of 200 maps.
        words: the finding in a sentence.
        edges: (bins + 1,) edges of the bins. mean: (bins,) mean residual. rms: (bins,) RMS residual. rows: (bins,).
    """

    coordinate: str
    unit: str
    range: tuple[float | None, float | None]
    share: float
    time_share: float
    chance: float
    explained: float
    explained_chance: float
    words: str
    edges: FloatArray = field(repr=False)
    mean: FloatArray = field(repr=False)
    rms: FloatArray = field(repr=False)
    rows: NDArray[np.int64] = field(repr=False)

    @property
    def significant(self) -> bool:
        """Whether the residual depends on this coordinate, in size or in value, more than by chance."""
        return self.share - self.time_share > self.chance or self.explained > max(self.explained_chance, 0.0)

    def to_json(self) -> dict[str, Any]:
        """The entry of ``where`` in gap.json."""
        return {
            "coordinate": self.coordinate,
            "unit": self.unit,
            "range": list(self.range),
            "share": self.share,
            "time_share": self.time_share,
            "explained": self.explained,
            "significant": self.significant,
            "words": self.words,
        }


def coordinates_at(recording: Recording, motion: Motion, time_s: FloatArray) -> dict[str, FloatArray]:
    """What was going on at given times.

    Args:
        recording: the run. motion: `smooth.motion_of` it. time_s: (m,) times within it.

    Returns:
        (m,) arrays: ``time position velocity speed direction acceleration current current_rate since_reversal``, and
        ``lateness`` where it was recorded; SI units.
    """
    row = np.clip(np.searchsorted(motion.time_s, time_s), 0, motion.time_s.size - 1)
    current = held_mean(recording, recording.current, motion.time_s, 0.0)
    reversals = np.flatnonzero(np.diff(np.sign(motion.velocity)) != 0)
    last = np.searchsorted(reversals, np.arange(motion.time_s.size), side="left") - 1
    begun = np.where(last >= 0, motion.time_s[reversals[last]] if reversals.size else 0.0, motion.time_s[0])
    values = {
        "time": motion.time_s,
        "position": motion.position,
        "velocity": motion.velocity,
        "speed": np.abs(motion.velocity),
        "direction": np.sign(motion.velocity),
        "acceleration": motion.acceleration,
        "current": current,
        "current_rate": velocity_of(current, motion.period_s),
        "since_reversal": motion.time_s - begun,
    }
    found = {name: np.asarray(value[row], dtype=np.float64) for name, value in values.items()}
    if recording.lateness_s is not None:
        found["lateness"] = np.interp(time_s, recording.time_s, recording.lateness_s)
    return found


def unit_of(coordinate: str, *, is_linear: bool) -> str:
    """Unit of a coordinate."""
    return (_UNITS | (_LINEAR if is_linear else _ROTARY)).get(coordinate, "")


def map_residual(
    residual: FloatArray,
    coordinates: Mapping[str, FloatArray],
    *,
    is_linear: bool = False,
    noise: float = 0.0,
    seed: int = 0,
) -> list[Place]:
    """Lay a residual over every coordinate.

    Args:
        residual: (m,) in order of time, m ≥ 4 a bin. coordinates: as `coordinates_at` gives them; ``time`` is needed.
        is_linear: for the units.
        noise: RMS of what the residual would be without any disagreement.
        seed: of the shifts that give the level of chance.

    Returns:
        Significant places first, those that explain most first among them.

    Raises:
        ValueError: too few rows.
    """
    if residual.size < 4 * BINS:
        raise ValueError(f"{residual.size} residuals are too few to say where they are large; {4 * BINS} are needed")
    blocks = Blocks.of(coordinates["time"])
    shifts = np.random.default_rng(seed).integers(residual.size // 20, residual.size - residual.size // 20, _SHIFTS)
    moved = [np.roll(residual, shift) for shift in shifts]
    places = [
        _place(name, unit_of(name, is_linear=is_linear), residual, values, coordinates, blocks, noise, moved)
        for name, values in coordinates.items()
        if np.ptp(values) > 0.0
    ]
    return sorted(
        places, key=lambda place: (not place.significant, -max(place.explained, place.share - place.time_share))
    )


def _place(
    name: str,
    unit: str,
    residual: FloatArray,
    values: FloatArray,
    coordinates: Mapping[str, FloatArray],
    blocks: Blocks,
    noise: float,
    moved: Sequence[FloatArray],
) -> Place:
    edges = bin_edges(values)
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    bins = edges.size - 1
    rows = np.bincount(index, minlength=bins)
    first, last, share, time_share = _densest(residual, index, rows, noise)
    explained = _explained(residual, index, bins, blocks)
    differences, parts = [], []
    for other in moved:
        _, _, high, spent = _densest(other, index, rows, noise)
        differences.append(high - spent)
        parts.append(_explained(other, index, bins, blocks))
    low_end = None if first == 0 else float(edges[first])
    high_end = None if last == bins - 1 else float(edges[last + 1])
    inside = (index >= first) & (index <= last)
    words = _words(name, unit, (low_end, high_end), share, _directions(residual, inside, coordinates.get("velocity")))
    total = np.maximum(rows, 1)
    return Place(
        coordinate=name,
        unit=unit,
        range=(low_end, high_end),
        share=share,
        time_share=time_share,
        chance=float(np.quantile(differences, _CHANCE)),
        explained=explained,
        explained_chance=float(np.quantile(parts, _CHANCE)),
        words=words,
        edges=edges,
        mean=np.bincount(index, residual, bins) / total,
        rms=np.sqrt(np.bincount(index, residual**2, bins) / total),
        rows=rows,
    )


def bin_edges(values: FloatArray) -> FloatArray:
    """Edges of at most `BINS` bins with equally many rows each; fewer where values repeat."""
    distinct = np.unique(values)
    if distinct.size <= BINS:
        middles = 0.5 * (distinct[1:] + distinct[:-1])
        return np.concatenate([distinct[:1], middles, distinct[-1:]])
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))


def _densest(
    residual: FloatArray, index: NDArray[np.int64], rows: NDArray[np.int64], noise: float
) -> tuple[int, int, float, float]:
    """First and last bin of the stretch whose share of the excess is most above its share of time, and both shares."""
    excess = np.bincount(index, residual**2 - noise**2, rows.size)
    total = float(excess.sum())
    if total <= 0.0:
        return 0, rows.size - 1, 0.0, 1.0
    share, spent = (
        np.concatenate([[0.0], np.cumsum(excess / total)]),
        np.concatenate([[0.0], np.cumsum(rows / rows.sum())]),
    )
    above = share - spent
    gain = above[None, 1:] - above[:-1, None]
    gain[np.tril_indices(rows.size, -1)] = -np.inf
    first, last = np.unravel_index(int(np.argmax(gain)), gain.shape)
    return int(first), int(last), float(share[last + 1] - share[first]), float(spent[last + 1] - spent[first])


def _explained(residual: FloatArray, index: NDArray[np.int64], bins: int, blocks: Blocks) -> float:
    """Part of the squared residual that the bins' means predict on folds they were not formed on."""
    centred = residual - residual.mean()
    before, after = float(centred @ centred), 0.0
    if before == 0.0:
        return 0.0
    sums = np.bincount(blocks.fold * bins + index, centred, blocks.folds * bins).reshape(blocks.folds, bins)
    counts = np.bincount(blocks.fold * bins + index, minlength=blocks.folds * bins).reshape(blocks.folds, bins)
    means = (sums.sum(axis=0) - sums) / np.maximum(counts.sum(axis=0) - counts, 1)
    left = centred - means[blocks.fold, index]
    after = float(left @ left)
    return 1.0 - after / before


def _directions(residual: FloatArray, inside: NDArray[np.bool_], velocity: FloatArray | None) -> str:
    if velocity is None or not inside.any():
        return ""
    power = residual[inside] ** 2
    forward = float(power[velocity[inside] > 0.0].sum()) / max(float(power.sum()), 1e-300)
    if _BOTH <= forward <= 1.0 - _BOTH:
        return ", in both directions"
    return f", mostly in the {'positive' if forward > 0.5 else 'negative'} direction"


def _words(name: str, unit: str, ends: tuple[float | None, float | None], share: float, directions: str) -> str:
    percent = f"{100.0 * share:.0f} % of the disagreement"
    low, high = ends
    if low is None and high is None:
        return f"the disagreement does not concentrate in {_NAMES.get(name, name)}"
    if name == "direction":
        return f"{percent} is in the {'positive' if high is None else 'negative'} direction"
    called = "" if name == "speed" else f"at {_NAMES.get(name, name)} "
    if low is None:
        where = f"{called}below {high:.3g} {unit}"
    elif high is None:
        where = f"{called}above {low:.3g} {unit}"
    else:
        where = f"{called}between {low:.3g} and {high:.3g} {unit}"
    signed = name in ("velocity", "time", "lateness")
    return f"{percent} sits {where}{'' if signed else directions}"
