"""The figure of ``hapticd check``: operating point, critical line and regions on the (β, σ) plane (left of Fig. 8).

Next to it: stiffness and damping at the hand over frequency (`hapticd.stability.linear_loop`) and, if no proof
covers the loop, the final state of every start (`hapticd.stability.figures.basins`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.config import apply_settings
from hapticd.figures.files import save_figure
from hapticd.figures.plane import middles, shade_regions
from hapticd.figures.style import BLUE, UNSTABLE, prefixed
from hapticd.stability.advice import Change
from hapticd.stability.assessment import Assessment, assess
from hapticd.stability.damping import velocity_filter
from hapticd.stability.figures.basins import basins, draw_basins
from hapticd.stability.linear_loop import effective
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.regions import critical_sigma, region
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hapticd.stability.uncertainty import Confidence

_MARKERS: Final = {"spring.stiffness": "D", "servo.rate_hz": ">", "encoder.decimation": "^", "hand.damping": "s"}
# Ratio of the point to the plane's corner above which the axis is logarithmic, so that the boundaries are visible.
_LINEAR_UP_TO: Final = 6.0
_SMALLEST: Final = 0.02


def check_figure(
    found: Assessment, changes: Sequence[Change], path: Path, title: str, sure: Confidence | None = None
) -> None:
    """Draw a configuration into a file; its suffix (.png, .svg, .pdf) is the format.

    Args:
        found: the assessment. changes: the advice, drawn as arrows.
        path: the file, replaced if it exists. title: name of the configuration.
        sure: the uncertainty of the operating point, drawn as a cloud.

    Raises:
        ValueError: there is no spring, so no operating point.
    """
    from matplotlib.figure import Figure

    if found.loop.stiffness == 0.0:
        raise ValueError("spring.stiffness is 0: there is no operating point to draw")
    widths = (7.2, 4.8) if found.explored is None else (7.2, 4.8, 5.6)
    figure = Figure(figsize=(sum(widths), 5.6), layout="constrained")
    plane, felt, *ends = figure.subfigures(1, len(widths), squeeze=False, width_ratios=widths)[0]
    axis = plane.subplots()
    targets = _targets(found, changes)
    shown = [(then.numbers.beta, then.numbers.sigma) for then in targets.values()]
    if sure is not None:
        shown += [(float(edge(sure.beta)), float(edge(sure.sigma))) for edge in (np.min, np.max)]
    beta, sigma = _scales(axis, found, shown)
    _regions(axis, found, beta, sigma)
    _lines(axis, found, beta)
    for change in changes:
        if change.key in targets:
            _arrow(axis, found, change, targets[change.key], beta)
    if sure is not None:
        label = f"its uncertainty: {sure.text.partition(';')[0]}"
        axis.plot(sure.beta, sure.sigma, ".", color=BLUE, alpha=0.35, ms=5, mew=0, zorder=3)
        axis.plot([], [], ".", color=BLUE, ms=5, label=label)
    axis.plot(
        found.numbers.beta, found.numbers.sigma, "o", color=BLUE, ms=10, mec="white", label="operating point", zorder=5
    )
    axis.set_xlim(beta[0], beta[-1])
    axis.set_ylim(sigma[0], sigma[-1])
    axis.set_xlabel("viscous friction β = b/(KT)")
    axis.set_ylabel("Coulomb friction σ = c/(KΔ)")
    axis.set_title(f"{title}: region {found.region}", loc="left", fontsize=12)
    axis.legend(fontsize=8, frameon=True, framealpha=0.9, loc="best")
    _felt(felt.subplots(2, 1, sharex=True), found)
    if found.explored is not None:
        draw_basins(ends[0], basins(found), found.explored)
    save_figure(figure, path)


def _felt(axes: Any, found: Assessment) -> None:
    """Effective stiffness and damping, up to half the servo rate, of the device without its hand."""
    no_hand = apply_settings(found.config, {"hand.inertia": 0.0, "hand.damping": 0.0, "hand.stiffness": 0.0})
    loop = loop_from_config(no_hand, found.latency_s)
    T, K, linear = loop.period, loop.stiffness, found.config.is_linear
    natural = math.sqrt(K / loop.inertia) / (2.0 * math.pi)
    hertz = np.geomspace(min(1e-3 * 0.5 / T, 0.03 * natural), 0.5 / T, 400)
    stiffness, damping = effective(loop, velocity_filter(found.config.spring, T), hertz)
    rendered = stiffness + loop.inertia * (2.0 * math.pi * hertz) ** 2
    units = ("N/m", "N s/m") if linear else ("N m/rad", "N m s/rad")
    factors = [prefixed(float(np.abs(y).max()), unit) for y, unit in zip((rendered, damping), units, strict=True)]
    slow = K, loop.viscous + loop.damping - K * (0.5 * T + loop.delay)
    names = ("stiffness", "K"), ("damping", "b + B − K(T/2 + T_D)")
    for axis, (factor, unit), limit, (name, slowly) in zip(axes, factors, slow, names, strict=True):
        axis.axhline(0.0, color="#777777", lw=0.8)
        axis.axhline(limit / factor, color="#777777", ls=":", lw=1.2, label=slowly)
        axis.set_ylabel(f"effective {name} ({unit})")
    (per_K, _), (per_B, _) = factors
    axes[0].semilogx(hertz, rendered / per_K, "--", color=BLUE, lw=1.2, label="without the device's inertia")
    axes[0].semilogx(hertz, stiffness / per_K, color=BLUE, lw=1.8, label="what a hand feels")
    low, high = min(0.0, float(rendered.min())), float(rendered.max())
    axes[0].set_ylim((low - 0.5 * high) / per_K, 1.15 * high / per_K)
    axes[0].set_title("what a hand feels, by frequency", loc="left", fontsize=12)
    axes[0].legend(fontsize=8, frameon=True, framealpha=0.9, loc="lower left")
    axes[1].semilogx(hertz, damping / per_B, color=BLUE, lw=1.8)
    axes[1].fill_between(
        hertz, damping / per_B, 0.0, where=damping < 0.0, color=UNSTABLE, label="below 0: pushes the hand"
    )
    _, high = axes[1].get_ylim()
    axes[1].set_ylim(top=high + 0.3 * (high - axes[1].get_ylim()[0]))
    axes[1].legend(fontsize=8, frameon=True, framealpha=0.9, loc="upper right", ncols=2)
    axes[1].set_xlabel("frequency (Hz)")
    axes[1].set_xlim(hertz[0], hertz[-1])


def _targets(found: Assessment, changes: Sequence[Change]) -> dict[str, Assessment]:
    """The assessment after each change of a setting."""
    return {
        change.key: assess(apply_settings(found.config, {change.key: change.after}), latency_s=found.latency_s)
        for change in changes
        if "." in change.key
    }


def _arrow(axis: Any, found: Assessment, change: Change, then: Assessment, beta: FloatArray) -> None:
    """The path of the operating point under a change, and the new critical line of the same motion."""
    x, y = then.numbers.beta, then.numbers.sigma
    style = {"arrowstyle": "->", "color": BLUE, "lw": 1.2}
    axis.annotate("", (x, y), (found.numbers.beta, found.numbers.sigma), arrowprops=style)
    label = f"{change.key} {change.before:g} → {change.after:g}, with its critical line"
    if found.start is None:
        label = label.removesuffix(", with its critical line")
    else:
        speed = found.start.xi_dot_max(then.loop)
        axis.plot(beta, [critical_sigma(then.numbers, speed, b) for b in beta], ":", color=BLUE, lw=1.0, alpha=0.8)
    axis.plot(x, y, _MARKERS.get(change.key, "o"), color="white", mec=BLUE, ms=7, label=label, zorder=4)


def _scales(axis: Axes, found: Assessment, targets: list[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """Both axes from near zero to beyond everything shown, logarithmic if a linear axis would hide something."""
    n = found.numbers
    ranges = []
    for value, others, least, corner, setter in (
        (n.beta, [p[0] for p in targets], 1.5, 0.5 + n.tau_d, axis.set_xscale),
        (n.sigma, [p[1] for p in targets], 2.0, n.quantum, axis.set_yscale),
    ):
        top = max(least, 2.0 * corner, 1.25 * value, *(1.15 * other for other in others))
        if top <= _LINEAR_UP_TO * max(1.0, corner):
            ranges.append(np.linspace(0.0, top, 600))
        else:
            setter("log")
            low = min([v for v in (value, *others) if v > 0.0] + [corner]) / 3.0
            ranges.append(np.geomspace(max(low, _SMALLEST * corner), 3.0 * top, 600))
    return ranges[0], ranges[1]


def _regions(axis: Any, found: Assessment, beta: FloatArray, sigma: FloatArray) -> None:
    """Shade and name the regions of this motion, or those that hold for every motion."""
    n, speed = found.numbers, found.xi_dot_max
    corner, half = 0.5 + n.tau_d, n.quantum
    line = (lambda b: np.full_like(b, half)) if speed is None else (lambda b: _critical(found, b))
    shade_regions(axis, beta, sigma, corner, half, line)
    axis.axhline(half, color="#777777", lw=0.8)
    axis.axvline(corner, color="#777777", lw=0.8)
    b, s = beta[::8], sigma[::8]
    names = np.array([[region(replace(n, beta=x, sigma=y), speed) for y in s.tolist()] for x in b.tolist()])
    for name, (x, y) in middles(b, s, names, least=0.03).items():
        axis.text(x, y, name, ha="center", va="center", fontsize=15, color="#555555", alpha=0.8)


def _critical(found: Assessment, beta: FloatArray, xi_dot: float | None = None) -> FloatArray:
    speed = found.xi_dot_max if xi_dot is None else xi_dot
    assert speed is not None
    return np.array([critical_sigma(found.numbers, speed, b) for b in beta])


def _lines(axis: Any, found: Assessment, beta: FloatArray) -> None:
    """The critical line of the motion; without a motion the line of the speed limit."""
    if found.xi_dot_max is None:
        if found.verdict == "depends" and np.isfinite(found.velocity_limit):
            line = _critical(found, beta, found.velocity_limit)
            label = f"critical line at the speed limit, {found.velocity_limit:.3g} ticks/period"
            axis.plot(beta, line, color="#8a1c12", lw=1.6, label=label)
        return
    label = f"critical line at {found.xi_dot_max:.3g} ticks/period"
    axis.plot(beta, _critical(found, beta), color="#8a1c12", lw=1.8, label=label)
