"""The missing force or torque: the estimated disturbance at each sample, and how much of it can be explained."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from hapticd.gap import constants
from hapticd.gap.kernel.linear import sensitivities, smoothed
from hapticd.gap.kernel.ticks import WHITE
from hapticd.gap.parallel import parallel_map
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.numeric import edited_base

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit

EVERYWHERE = "everywhere"
"""The coordinate of a constant force."""
_PROBES = 64
_PERIODS = 10
_HATS, _RANGES = 8, 12
"""Parameters of a flexible function of a coordinate, and bins of it in which the missing force is reported."""


@dataclass(frozen=True)
class Missing:
    """The missing force at n samples, N m or N.

    Attributes:
        force: (n,) mean given all samples. variance: (n,) its variance.
        velocity: (n,) smoothed, rad/s or m/s. position: (n,) filtered, rad or m.
        moves: (n,) whether the shaft moves, so that a force has a visible effect.
    """

    force: Floats
    variance: Floats
    velocity: Floats
    position: Floats
    moves: NDArray[np.bool_]

    @property
    def power(self) -> Floats:
        """(n,) expected square of the force, 0 where the shaft rests."""
        return np.where(self.moves, self.force**2 + self.variance, 0.0)

    @property
    def rms(self) -> float:
        """Root mean square while the shaft moves, of mean and variance together."""
        return float(np.sqrt(self.power.sum() / max(int(self.moves.sum()), 1)))


def missing_force(fit: Fit) -> Missing:
    """The missing force of a fitted model."""
    return _smoothed(fit, fit.u, fit.out)


def _smoothed(fit: Fit, u: Floats, out: NDArray[Any]) -> Missing:
    series = fit.problem.series
    found = smoothed(out, white_variance(fit, u))
    # Of the white force only its mean over a window counts as missing.
    lasting = uniform_filter1d(found[:, 3], max(int(constants.LASTING_S / series.period_s), 1), mode="nearest")
    return Missing(found[:, 1] + lasting, found[:, 2], found[:, 0], out["x"].copy(), moving(fit, u, out))


def white_variance(fit: Fit, u: Floats | None = None) -> Floats:
    """(n,) variance of the mean white force until the next sample: noise, and commands that may have been lost."""
    duration, _, spread = fit.currents(u)
    period = duration.sum(axis=1)
    lost = np.sum((torque_constant(fit.device(u)) * spread * duration) ** 2, axis=1) / period**2
    return np.asarray(float(fit.noise_values(u)[WHITE]) ** 2 / period + lost)


def moving(fit: Fit, u: Floats | None = None, out: NDArray[Any] | None = None) -> NDArray[np.bool_]:
    """(n,) whether the shaft moves in the period after each sample; `u`, `out`: coordinates and their ticks."""
    p = fit.device(u)
    inertia, viscous, *_ = edited_base(p)
    period = fit.problem.series.currents(p)[0].sum(axis=1)
    outlasts = (fit.out if out is None else out)["v_v"]
    return np.asarray(outlasts > constants.MOVES * np.exp(-viscous * period / inertia))


def missing_power(fit: Fit) -> float:
    """Mean square of the missing force, (N m)² or N²; infinite if the shaft never moves in the model."""
    found = missing_force(fit)
    return found.rms**2 if found.moves.any() else math.inf


def held_out_rms(fit: Fit) -> float:
    """Held-out RMS of the missing force, each block by parameters without its fold; call `Fit.held_out` before."""
    series = fit.problem.series

    def of_fold(fold: int) -> tuple[float, int]:
        u = fit.fold_u[fold]
        found = _smoothed(fit, u, fit.out if u is fit.u else fit.evaluate(u)[1])
        inside = series.fold[series.block] == fold
        return float(found.power[inside].sum()), int(found.moves[inside].sum())

    power, count = map(sum, zip(*parallel_map(of_fold, range(constants.FOLDS)), strict=True))
    return float(np.sqrt(power / max(count, 1)))


def own_torque(fit: Fit) -> float:
    """RMS of the torques of friction and current in a model, N m or N."""
    _, viscous, coulomb, *_ = edited_base(fit.device())
    duration, current, _ = fit.currents()
    drive = torque_constant(fit.device()) * np.sqrt(np.sum(duration * current**2) / np.sum(duration))
    return float(drive + coulomb + viscous * np.sqrt(np.mean(fit.out["v"] ** 2)))


def noise_floor(fit: Fit) -> float:
    """Standard error of a force that is constant over `constants.WINDOW_S`, and some periods at least, N m or N."""
    series = fit.problem.series
    rows = max(int(constants.WINDOW_S / series.period_s), _PERIODS)
    first = np.linspace(0, max(series.size - 4 * rows, 0), _PROBES).astype(np.int64)
    columns = np.zeros((series.size, _PROBES))
    for k, row in enumerate(first):
        columns[row : row + rows, k] = 1.0
    answer = sensitivities(fit.out, columns)
    information = np.einsum("nk,n->k", answer**2, fit.out["information"])
    moves = moving(fit)
    determined = np.array([bool(np.all(moves[row : row + rows])) for row in first]) & (information > 0.0)
    return float(np.sqrt(np.mean(1.0 / information[determined]))) if determined.any() else 0.0


def hats(values: Floats, among: NDArray[np.bool_]) -> Floats | None:
    """Hat functions (piecewise linear) of a coordinate at its quantiles, shape (n, k); None if it hardly varies."""
    edges = np.unique(np.quantile(values[among], np.linspace(0.01, 0.99, _HATS)))
    if edges.size < 3:
        return None
    return np.stack([np.interp(values, edges, row) for row in np.eye(edges.size)], axis=1)


def _last(values: Floats) -> Floats:
    """Values at each sample and at the samples before it, shape (n, `_HATS`)."""
    return np.stack([np.concatenate([np.zeros(k), values[: values.size - k]]) for k in range(_HATS)], axis=1)


def since_reversal(
    velocity: Floats, position: Floats, moves: NDArray[np.bool_], begins: NDArray[np.bool_] | bool = False
) -> Floats:
    """(n,) distance since the velocity last changed its sign, or since the start of the record, rad or m."""
    sign = np.where(moves, np.sign(velocity), 0.0)
    turned = np.flatnonzero((np.diff(sign, prepend=sign[0]) != 0.0) | begins)
    last = np.zeros(sign.size, dtype=np.int64)
    last[turned] = turned
    return np.abs(position - position[np.maximum.accumulate(last)])


def coordinates(fit: Fit, found: Missing) -> dict[str, tuple[Floats, Floats | None]]:
    """Coordinates that a missing force may depend on: (n,) values, and a (n,) sign factor or None.

    Motion and current are predictions from before the force acted: afterwards they contain the effect of the force
    itself, in closed loop also the current.
    """
    series = fit.problem.series
    velocity = fit.out["v"]
    direction = np.where(found.moves, np.sign(velocity), 0.0)
    way = since_reversal(velocity, found.position, found.moves, series.begins)
    current = series.commands(fit.filter_s())
    change = np.where(series.begins, 0.0, np.diff(current, prepend=current[0]))
    return {
        "position": (found.position, None),
        "velocity": (velocity, None),
        "speed, against the motion": (np.abs(velocity), direction),
        "current": (current, None),
        "time": (series.time_s, None),
        "time, against the motion": (series.time_s, direction),
        "way since a reversal, against the motion": (np.log(way + series.resolution), direction),
        "position, against the motion": (found.position, direction),
        "acceleration": ((fit.out["next_v"] - velocity) / series.period_s, None),
        "change of the current": (change / series.period_s, None),
    }


def explainable(fit: Fit, found: Missing) -> float:
    """Share of the missing force's power that flexible functions of the coordinates predict on other blocks.

    Of all coordinates together, or of the best one alone: many functions at once may overfit.
    """
    among = found.moves
    columns = [shape[among] for _, shape in _functions(fit, found)]
    fold = fit.problem.series.fold[fit.problem.series.block][among]
    target = found.force[among]
    return max(_predicted(design, target, fold) for design in (np.concatenate(columns, axis=1), *columns))


def _predicted(design: Floats, target: Floats, fold: NDArray[np.int64]) -> float:
    """Share of a force's power that columns predict on held-out folds, at least 0."""
    total = float(np.sum(target**2))
    if total == 0.0:
        return 0.0
    gram = [design[fold == k].T @ design[fold == k] for k in range(constants.FOLDS)]
    cross = [design[fold == k].T @ target[fold == k] for k in range(constants.FOLDS)]
    left = 0.0
    for k in range(constants.FOLDS):
        H, g = sum(gram) - gram[k], sum(cross) - cross[k]
        if not np.any(H):  # the shaft moves only in this fold: nothing to fit
            left += float(np.sum(target[fold == k] ** 2))
            continue
        H = H + 1e-3 * np.diag(np.diag(H)) + 1e-12 * np.trace(H) * np.eye(H.shape[0])
        left += float(np.sum((target[fold == k] - design[fold == k] @ np.linalg.solve(H, g)) ** 2))
    return max(1.0 - left / total, 0.0)


@dataclass(frozen=True)
class Dependence:
    """How much of a missing force is a function of one coordinate, or constant.

    Attributes:
        coordinate: its name. share: of the missing force's power. errors: held-out gain in standard errors.
        ends: of the range that contains most of it; for a constant force, its value twice.
    """

    coordinate: str
    share: float
    errors: float
    ends: tuple[float, float]


def dependences(fit: Fit, found: Missing) -> list[Dependence]:
    """The coordinates on which a model's missing force depends, held out, by descending evidence."""
    tested = {function.coordinate: function for function in structure(fit, found)}
    total = float(found.power.sum())
    if not tested or total <= 0.0:
        return []
    moves = found.moves
    constant = float(tested[EVERYWHERE].force[0])
    share = min(constant**2 * int(moves.sum()) / total, 1.0)
    table = [Dependence(EVERYWHERE, share, tested.pop(EVERYWHERE).errors, (constant, constant))]
    places = coordinates(fit, found)
    for name, function in tested.items():
        values, factor = places[name]
        # A constant force would appear as a function of every coordinate.
        force = function.force[moves] - constant
        share = min(float(force @ force) / total, 1.0)
        ends = _range(values[moves], force * (1.0 if factor is None else factor[moves]))
        if name.startswith("way"):
            ends = float(np.exp(ends[0])), float(np.exp(ends[1]))
        table.append(Dependence(name, share, function.errors, ends))
    return sorted(table, key=lambda entry: -entry.share)


def _range(values: Floats, force: Floats) -> tuple[float, float]:
    """Ends of the range of a coordinate that contains most of a force."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _RANGES + 1)))
    if edges.size < 2:
        return float(values.min()), float(values.max())
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(place, minlength=edges.size - 1)
    mean = np.bincount(place, force, edges.size - 1) / np.maximum(count, 1)
    first, last = _densest(mean**2 * count)
    return float(edges[first]), float(edges[last + 1])


def _densest(power: Floats) -> tuple[int, int]:
    """First and last bin of the shortest range that contains most of the power."""
    size = power.size
    for length in range(1, size + 1):
        sums = [float(power[k : k + length].sum()) for k in range(size - length + 1)]
        best = int(np.argmax(sums))
        if sums[best] >= 0.6 * float(power.sum()):
            return best, best + length - 1
    return 0, size - 1


def structure(fit: Fit, found: Missing) -> list[Structure]:
    """Structure of the innovations: held-out gain of flexible functions, by the linearised filter."""
    fold, own = fit.problem.series.fold[fit.problem.series.block], fit.own_slopes

    def tested(function: tuple[str, Floats]) -> Structure:
        name, columns = function
        numbers = columns.shape[1]
        whole = np.concatenate([sensitivities(fit.out, columns.copy()), own], axis=1)
        coefficients = held_out_coefficients(fit, whole)
        gain, errors = _gain(fit, np.sum(whole * coefficients[fold], axis=1))
        g, H = _normal_equations(fit, whole)
        force = columns @ np.linalg.solve(H, g)[:numbers]
        held_out = np.sum(columns * coefficients[fold, :numbers], axis=1)
        return Structure(name, numbers, gain, errors, force, held_out)

    return parallel_map(tested, _functions(fit, found))


def _functions(fit: Fit, found: Missing) -> Iterator[tuple[str, Floats]]:
    """Torques that are flexible functions of each coordinate, shape (n, k).

    For the last changes of the current they are linear functions, as the effect of any delay or filter of the current.
    """
    if not found.moves.any():
        return
    yield EVERYWHERE, np.ones((found.moves.size, 1))
    for name, (values, factor) in coordinates(fit, found).items():
        shape = _last(values) if name == "change of the current" else hats(values, found.moves)
        if shape is not None:
            yield name, np.ascontiguousarray(shape if factor is None else shape * factor[:, None])


@dataclass(frozen=True)
class Structure:
    """A flexible function of one coordinate.

    Attributes:
        coordinate: its name. numbers: number of parameters. gain: held-out, nats. errors: the same in standard errors.
        force: (n,) the function, N m or N. held_out: (n,) the same, fitted without the fold of each block.
    """

    coordinate: str
    numbers: int
    gain: float
    errors: float
    force: Floats
    held_out: Floats


def _normal_equations(fit: Fit, whole: Floats, rows: NDArray[np.bool_] | None = None) -> tuple[Floats, Floats]:
    """Gradient and information of directions of the prediction, shape (n, k), on some of the samples.

    A ridge from the information of all samples keeps coefficients near 0 that those samples do not determine.
    """
    score, information = fit.out["score"], fit.out["information"]
    ridge = constants.HELD_BACK * np.einsum("nk,nk,n->k", whole, whole, information) + 1e-30
    if rows is not None:
        whole, score, information = whole[rows], score[rows], information[rows]
    H = (whole * information[:, None]).T @ whole
    return whole.T @ score, H + np.diag(ridge)


def held_out_coefficients(fit: Fit, whole: Floats) -> Floats:
    """Coefficients of directions without each fold, shape (folds, k)."""
    fold = fit.problem.series.fold[fit.problem.series.block]
    equations = (_normal_equations(fit, whole, fold != k) for k in range(constants.FOLDS))
    return np.stack([np.linalg.solve(H, g) for g, H in equations])


def held_out_gain(fit: Fit, answer: Floats) -> tuple[float, float]:
    """Held-out gain of directions of the prediction, shape (n, k), in nats and in standard errors.

    The model's own coordinates are fitted together with them.
    """
    whole = np.concatenate([answer, fit.own_slopes], axis=1)
    fold = fit.problem.series.fold[fit.problem.series.block]
    return _gain(fit, np.sum(whole * held_out_coefficients(fit, whole)[fold], axis=1))


def _gain(fit: Fit, shift: Floats) -> tuple[float, float]:
    score, information = fit.out["score"], fit.out["information"]
    gain = float(np.sum(shift * score - 0.5 * shift**2 * information))
    return gain, fit.problem.series.standard_errors(gain, shift * (score - shift * information))
