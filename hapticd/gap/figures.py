"""The figures of the gap report: the missing force before and after, over time and over the coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from hapticd.effects.catalogue import CATALOGUE
from hapticd.figures.style import BLUE, GREY, INK, ORANGE, new_figure
from hapticd.gap.checks import GAP_PERIODS
from hapticd.gap.missing import since_reversal
from hapticd.gap.text import COORDINATES, is_linear

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hapticd.gap.profile import Profile
    from hapticd.gap.result import GapResult, Step
    from hapticd.gap.validation import Validation

Floats = NDArray[np.float64]

_WIDTH: Final = 9.0
_COLUMNS: Final = 700
"""Points of a line over time: the resolution of a figure of this width."""
_BINS: Final = 18
"""Bins of equal width, and as many with equal numbers of samples."""
_CLOSE: Final = 0.03
"""Share of the highest speed below which a label would overlap the label of 0."""
_FLOORS: Final = 3.0
_FEWEST: Final = 10
"""Least number of samples in a bin."""
_PREFIXES: Final = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def _prefix(values: Sequence[Floats], unit: str, floor: float) -> tuple[float, str]:
    """Scale factor and prefixed unit in which values are easy to read.

    Args:
        values: to be shown. unit: their unit. floor: the noise floor, which is always shown.
    """
    known = [part[np.isfinite(part)] for part in values]
    largest = max((float(np.abs(part).max()) for part in known if part.size), default=0.0)
    for size, letter in _PREFIXES:
        if max(largest, floor) >= size:
            return 1.0 / size, f"{letter}{unit}"
    return 1.0, unit


def _with_floor(axis: Axes, floor: float) -> None:
    """Let the axis span at least a few times the noise floor."""
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, -_FLOORS * floor), max(high, _FLOORS * floor))


def over_time(profiles: Sequence[Profile], unit: str, floor: float) -> Figure:
    """The missing force of each recording over time, with ± one standard deviation of the remainder.

    No line is drawn where the shaft rests, nor across missing samples.
    """
    figure = new_figure(_WIDTH, 0.3 + 2.6 * len(profiles))
    axes = figure.subplots(len(profiles), 1, squeeze=False)[:, 0]
    for axis, profile in zip(axes, profiles, strict=True):
        parts = _parts(profile.time_s)
        time_s = np.array([profile.time_s[part].mean() if part.size else np.nan for part in parts])
        before, after, deviation = (
            _thinned(values, profile.moves, parts) for values in (profile.before, profile.after, profile.deviation)
        )
        factor, label = _prefix([before, after], unit, floor)
        axis.plot(time_s, factor * before, color=ORANGE, lw=1.0, label="model as given")
        axis.fill_between(
            time_s, factor * (after - deviation), factor * (after + deviation), color=BLUE, alpha=0.25, lw=0
        )
        axis.plot(time_s, factor * after, color=BLUE, lw=1.0, label="improved model, ± 1 standard deviation")
        for end in (-floor, floor):
            axis.axhline(factor * end, color=GREY, lw=0.8, ls="--", label="noise floor" if end > 0.0 else None)
        _with_floor(axis, factor * floor)
        axis.set_title(f"{profile.name}: missing force")
        axis.set_ylabel(label)
        axis.set_xlabel("s")
    # above the titles: a recording's name may be as long as the figure is wide
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return figure


def _parts(time_s: Floats) -> list[NDArray[np.intp]]:
    """Rows of each point of a line over time; an empty part breaks the line where samples are missing."""
    waits = np.diff(time_s)
    hole = max(GAP_PERIODS * float(np.median(waits)), float(np.ptp(time_s)) / _COLUMNS)
    parts: list[NDArray[np.intp]] = []
    for stretch in np.split(np.arange(time_s.size), np.flatnonzero(waits > hole) + 1):
        points = max(2, _COLUMNS * stretch.size // time_s.size)  # a line needs two points
        parts += [*np.array_split(stretch, min(points, stretch.size)), np.empty(0, dtype=np.intp)]
    return parts[:-1]


def _thinned(values: Floats, moves: NDArray[np.bool_], parts: Sequence[NDArray[np.intp]]) -> Floats:
    """Mean of the moving samples of each part; NaN where the shaft rests, or samples are missing."""
    return np.array([values[part][moves[part]].mean() if moves[part].any() else np.nan for part in parts])


@dataclass(frozen=True)
class _Axis:
    """A horizontal axis for the missing force.

    Attributes:
        name: coordinate. values: of a recording, shape (n,). against: whether the force is multiplied by the direction of
            motion, so that friction has the same sign both ways. scale: of the axis; "root" shows low and high speeds.
    """

    name: str
    values: Callable[[Profile], Floats]
    against: bool = False
    scale: Literal["linear", "log", "root"] = "linear"


def _way(profile: Profile) -> Floats:
    return since_reversal(profile.velocity, profile.position, profile.moves)


def _rate(values: Floats, profile: Profile) -> Floats:
    return np.asarray(np.gradient(values, profile.time_s))


_AXES: Final = {
    axis.name: axis
    for axis in (
        _Axis("position", lambda p: p.position),
        _Axis("velocity", lambda p: p.velocity, scale="root"),
        _Axis("current", lambda p: p.current),
        _Axis("time", lambda p: p.time_s),
        _Axis("acceleration", lambda p: _rate(p.velocity, p)),
        _Axis("change of the current", lambda p: _rate(p.current, p)),
        _Axis("speed, against the motion", lambda p: np.abs(p.velocity), True, "root"),
        _Axis("time, against the motion", lambda p: p.time_s, True),
        _Axis("position, against the motion", lambda p: p.position, True),
        _Axis("way since a reversal, against the motion", _way, True, "log"),
    )
}
_SHOWN: Final = ("position", "velocity", "current")


def _within_a_turn(profile: Profile) -> Floats:
    return profile.position - 2.0 * np.pi * np.rint(profile.position / (2.0 * np.pi))


def laws(profiles: Sequence[Profile], unit: str, floor: float, *, in_angle: bool = False) -> Figure:
    """The missing force over position, velocity and current, before and after.

    Args:
        profiles: of all recordings. unit: of the force. floor: the noise floor.
        in_angle: whether a law is periodic in the angle, so that all turns are overlaid.
    """
    figure = new_figure(_WIDTH, 3.0)
    axes = figure.subplots(1, len(_SHOWN), sharey=True)
    factor, label = _prefix([_pooled(profiles, lambda p: p.before)], unit, floor)
    for axis, name in zip(axes, _SHOWN, strict=True):
        for part, colour, words in (("before", ORANGE, "model as given"), ("after", BLUE, "improved model")):
            shown = _Axis(name, _within_a_turn) if in_angle and name == "position" else _AXES[name]
            _band(axis, profiles, shown, part, factor, colour, words)
        axis.axhline(0.0, color=GREY, lw=0.8)
        axis.set_xlabel(_labelled(name, unit))
    if in_angle:
        axes[0].set_xlabel("position within a turn, rad")
    _with_floor(axes[0], factor * floor)
    axes[0].set_ylabel(f"missing force, {label}")
    axes[0].legend()
    return figure


def left(profiles: Sequence[Profile], coordinate: str, unit: str, floor: float) -> Figure:
    """The remainder over the coordinate that it depends on most."""
    axis = _AXES[coordinate]
    figure = new_figure(_WIDTH, 3.0)
    panel = figure.subplots()
    factor, label = _prefix([_binned(profiles, axis, "after")[1]], unit, floor)
    _band(panel, profiles, axis, "after", factor, BLUE, "left by the improved model")
    panel.axhline(0.0, color=GREY, lw=0.8)
    _with_floor(panel, factor * floor)
    panel.set_xlabel(_labelled(coordinate, unit))
    panel.set_ylabel(f"missing force{' along the motion' if axis.against else ''}, {label}")
    panel.legend()
    return figure


def _labelled(name: str, unit: str) -> str:
    scale = " (square-root scale)" if _AXES[name].scale == "root" else ""
    return f"{name.partition(',')[0]}, {COORDINATES[name][is_linear(unit)]}{scale}"


def _pooled(profiles: Sequence[Profile], of: Callable[[Profile], Floats]) -> Floats:
    """Values of all moving samples."""
    return np.concatenate([of(profile)[profile.moves] for profile in profiles])


def _band(
    panel: Axes, profiles: Sequence[Profile], axis: _Axis, part: str, factor: float, colour: str, words: str
) -> None:
    """Mean over bins of a coordinate, and the standard deviation of single samples."""
    centre, mean, spread = _binned(profiles, axis, part)
    panel.fill_between(centre, factor * (mean - spread), factor * (mean + spread), color=colour, alpha=0.22, lw=0)
    panel.plot(centre, factor * mean, "o-", color=colour, lw=1.2, ms=2.5, label=words)
    if axis.scale == "log":
        panel.set_xscale("log")
    elif axis.scale == "root" and centre.size:
        panel.set_xscale("function", functions=(_root, lambda r: np.sign(r) * np.square(r)))
        top = max(float(np.abs(centre).max()), np.finfo(float).tiny)
        largest = 10.0 ** np.floor(np.log10(top))
        ends = largest * np.array([-5.0, -1.0, -0.1, 0.0, 0.1, 1.0, 5.0])
        legible = (np.abs(ends) <= top) & ((ends == 0.0) | (np.abs(ends) > _CLOSE * top))
        panel.set_xticks(ends[legible & (ends >= min(0.0, centre.min()))].tolist())


def _root(values: Floats) -> Floats:
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


def _binned(profiles: Sequence[Profile], axis: _Axis, part: str) -> tuple[Floats, Floats, Floats]:
    """Mean coordinate, mean force and its standard deviation in bins."""
    at = _pooled(profiles, axis.values)
    force = _pooled(profiles, lambda p: getattr(p, part) * (np.sign(p.velocity) if axis.against else 1.0))
    if axis.scale == "log":
        at, force = at[at > 0.0], force[at > 0.0]
    if at.size < _FEWEST:
        return np.empty(0), np.empty(0), np.empty(0)
    z = _SCALES[axis.scale](at)
    grid = np.linspace(0.0, 1.0, _BINS + 1)
    edges = np.concatenate([np.quantile(z, grid), z.min() + grid * np.ptp(z)])
    if axis.scale == "root" and not axis.against:
        edges = np.append(edges, 0.0)  # friction is discontinuous at 0
    edges = np.unique(edges)
    place = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, max(edges.size - 2, 0))
    groups = [group for k in range(max(edges.size - 1, 1)) if (group := place == k).sum() >= _FEWEST]
    return (
        np.array([at[group].mean() for group in groups]),
        np.array([force[group].mean() for group in groups]),
        np.array([force[group].std() for group in groups]),
    )


_SCALES: Final[dict[str, Callable[[Floats], Floats]]] = {"linear": np.asarray, "log": np.log, "root": _root}


def ranking(step: Step) -> Figure:
    """The candidates of one round: held-out gain and evidence of each."""
    shown = sorted(step.ranking, key=lambda one: one.gain)
    figure = new_figure(_WIDTH, 0.8 + 0.28 * len(shown))
    axis = figure.subplots()
    indistinguishable = {step.effect, *step.indistinguishable_from}
    gains = [max(one.gain, 0.0) for one in shown]
    bars = axis.barh(
        [one.effect for one in shown], gains, color=[BLUE if one.effect in indistinguishable else GREY for one in shown]
    )
    axis.bar_label(bars, [f"{one.evidence:.1f} standard errors" for one in shown], padding=4, fontsize=8.5)
    axis.set_xlim(0.0, 1.25 * max(*gains, 1.0))
    axis.set_xlabel("gain on held-out data, nats (blue: added, or tied with it)")
    return figure


def measured_and_predicted(validation: Validation) -> Figure:
    """Measured and predicted position of a recording that was not fitted, and the errors of the predictions.

    No line is drawn where a prediction is wrong by more than the range of the motion, nor across missing samples.
    """
    before, after = validation.before, validation.after
    time_s, measured, span = before.time_s, before.measured, float(np.ptp(before.measured))
    rows = np.array([part[part.size // 2] if part.size else -1 for part in _parts(time_s)])
    unit = str(validation.errors["unit"])
    figure = new_figure(_WIDTH, 7.0)
    over, error, ahead = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))

    def near(values: Floats) -> Floats:
        known = np.abs(values - measured) <= span
        return np.where(known, values, np.nan)

    def line(axis: Axes, values: Floats, colour: str, words: str, width: float = 1.0) -> None:
        axis.plot(np.append(time_s, np.nan)[rows], np.append(values, np.nan)[rows], color=colour, lw=width, label=words)

    models = (("model as given", ORANGE, before), ("improved model", BLUE, after))
    factor, label = _prefix([measured], unit, 0.0)
    line(over, factor * measured, GREY, "measured", 3.0)
    for model, colour, predicted in models:
        line(over, factor * near(predicted.free_run), colour, f"free run, {model}")
    over.set_ylabel(f"position, {label}")
    over.set_title(f"{validation.run}, which was not fitted")
    free_runs, k_steps = (
        [near(getattr(one, name)) - measured for _, _, one in models] for name in ("free_run", "k_step")
    )
    factor, label = _prefix(free_runs, unit, 0.0)
    for (model, colour, _), values in zip(models, free_runs, strict=True):
        line(error, factor * values, colour, model)
    error.set_ylabel(f"error of the free run,\n{label}")
    factor, label = _prefix(k_steps, unit, 0.0)
    for (model, colour, _), values in zip(models, k_steps, strict=True):
        ahead.plot(time_s, factor * values, ".", color=colour, ms=2.5, label=model)
    ahead.set_ylabel(f"error {1e3 * validation.errors['horizon_s']:.3g} ms ahead,\n{label}")
    ahead.set_xlabel("s")
    for axis in (error, ahead):
        axis.axhline(0.0, color=INK, lw=0.6)
    figure.legend(*over.get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return figure


def all_figures(result: GapResult) -> dict[str, Any]:
    """Name to figure, in the order of the report."""
    figures: dict[str, Any] = {}
    profiles, unit, floor = result.profiles, result.gap.unit, result.gap.noise_floor
    moved = any(profile.moves.any() for profile in profiles)
    if moved:
        figures["time"] = over_time(profiles, unit, floor)
        in_angle = any(CATALOGUE[slug].rotary_only for slug in result.effects)
        figures["laws"] = laws(profiles, unit, floor, in_angle=in_angle)
    if result.validation:
        figures["tested"] = measured_and_predicted(result.validation)
    figures |= {f"ranking-{number}": ranking(step) for number, step in enumerate(result.steps, 1) if step.ranking}
    if moved and result.remainder.structure:
        figures["left"] = left(profiles, result.remainder.structure[0]["coordinate"], unit, floor)
    return figures
