"""Distribution of the shaft's state: up to three normal distributions, one for each mode of friction.

Held by friction, moving up, or moving down: each mode has a probability, and mean and covariance of the state. A single
normal distribution is not enough: a held shaft has exactly zero velocity, and a breakaway gives information on the
disturbance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types

from hapticd.gap.kernel.cell import truncated
from hapticd.gap.kernel.ticks import TICK
from hapticd.jit import njit
from hapticd.plant.layout import index_of
from hapticd.plant.numeric import measured

if TYPE_CHECKING:
    from numpy.typing import NDArray

HELD, UP, DOWN, STOPPED = range(4)
"""Mode of the shaft; STOPPED: of a piece that moved and will be held."""
STATES, SHAFT, W = 6, 4, 3
"""Position, velocity, disturbance torque, w during a period, and the load's position and velocity: six numbers, four
without a load. Loops over a number known at compile time are unrolled."""

MODE = np.dtype(
    [
        ("weight", "f8"),  # probability; 0 for an empty mode
        ("likeliest", "f8"),  # scratch: probability of the likeliest piece in it
        ("mean", "f8", STATES),
        ("covariance", "f8", (STATES, STATES)),
        ("bristle", "f8"),
        ("bristle_x", "f8"),  # regression of the bristle on the position
        ("contact", "f8"),  # side on which a play is closed, or 0
        ("gain", "f8", STATES),  # scratch: regression of the state on the measurement, or on w; difference of means
        ("expected", "f8"),  # scratch: predicted measurement, its slope, its variance, and its moments in the cell
        ("seen", "f8"),
        ("variance", "f8"),
        ("mass", "f8"),
        ("exponent", "f8"),
        ("cell_mean", "f8"),
        ("kept", "f8"),
    ],
    align=True,
)
"""A mode, or a piece of one."""

OUTLIER = 1e-3 / 64.0
"""Probability of an arbitrary count, or of a width of the sensor's noise if that is wider: for gross outliers."""
RARE = 1e-12
"""Probability below which a mode is dropped. If it were above that of an outlier, an unlikely motion of the shaft would
be lost, and the likelihood would jump where a mode is dropped."""

_f8 = types.float64
_i8 = types.int64
_a = types.Array(_f8, 1, "C")
_mode = from_dtype(MODE)
_modes = types.Array(_mode, 1, "C")
_rows = types.Array(from_dtype(TICK), 1, "C")
_BREAKAWAY = index_of("presliding.breakaway")
_ECCENTRICITY = index_of("encoder_eccentricity.e")


@njit(types.void(_mode, _mode, _f8, _f8, _f8, _i8), counted=False, inline=True)
def _join(r: Any, piece: Any, weight: float, shift: float, taken: float, size: int) -> None:
    if r.weight == 0.0:
        r.weight = r.likeliest = weight
        r.bristle, r.bristle_x, r.contact = piece.bristle, piece.bristle_x, piece.contact
        for j in range(size):
            r.mean[j] = piece.mean[j] + shift * piece.gain[j]
            narrowed = taken * piece.gain[j]
            for k in range(j + 1):
                r.covariance[j, k] = r.covariance[k, j] = piece.covariance[j, k] - narrowed * piece.gain[k]
        return
    r.weight += weight
    part = weight / r.weight
    rest = 1.0 - part
    if weight > r.likeliest:
        r.likeliest, r.contact = weight, piece.contact
    r.bristle += part * (piece.bristle - r.bristle)
    r.bristle_x += part * (piece.bristle_x - r.bristle_x)
    for j in range(size):
        r.gain[j] = piece.mean[j] + shift * piece.gain[j] - r.mean[j]
        r.mean[j] += part * r.gain[j]
    for j in range(size):
        narrowed, apart = part * taken * piece.gain[j], part * rest * r.gain[j]
        for k in range(j + 1):
            both = rest * r.covariance[j, k] + part * piece.covariance[j, k]
            r.covariance[j, k] = r.covariance[k, j] = both - narrowed * piece.gain[k] + apart * r.gain[k]


@njit(types.void(_mode, _mode, _f8, _f8, _f8, _i8), counted=False)
def join(r: Any, piece: Any, weight: float, shift: float, taken: float, size: int) -> None:
    """Merge a piece into another: mean and covariance of both together, contact of the more probable one.

    Args:
        r: changed in place; without weight, it becomes the piece.
        piece: its mean is moved by `shift` times its `gain`, its covariance reduced by `taken` times gain times gain.
        weight: probability of the piece.
        shift: see `piece`.
        taken: see `piece`.
        size: of the state.
    """
    if size == SHAFT:
        _join(r, piece, weight, shift, taken, SHAFT)
    else:
        _join(r, piece, weight, shift, taken, STATES)


@njit(types.void(_mode, _f8, _f8, _f8, _f8, _i8), counted=False, inline=True)
def take(mode: Any, seen: float, variance: float, share: float, moved: float, size: int) -> None:
    """Update mean and covariance of a mode with a measurement.

    Args:
        mode: changed in place.
        seen: d measurement / d position. variance: of the measurement. share: of it that the count removes.
        moved: mean of the measurement given the count, minus its prediction.
        size: of the state.
    """
    for j in range(size):
        mode.gain[j] = seen * mode.covariance[0, j] / variance
        mode.mean[j] += mode.gain[j] * moved
    for j in range(size):
        for k in range(size):
            mode.covariance[j, k] -= mode.gain[j] * mode.gain[k] * variance * share


@njit(types.void(_mode, _f8, _f8, _i8), counted=False, inline=True)
def _spread(r: Any, half: float, slide: float, size: int) -> None:
    S = r.covariance
    for j in range(size):
        moved = slide * S[W, j]
        S[0, j] += half * (S[1, j] + moved)
        S[1, j] = moved
        if size == STATES:
            S[4, j] += 2.0 * half * S[5, j]
    for j in range(size):
        moved = slide * S[j, W]
        S[j, 0] += half * (S[j, 1] + moved)
        S[j, 1] = moved
        if size == STATES:
            S[j, 4] += 2.0 * half * S[j, 5]


@njit(types.void(_mode, _f8, _f8, _i8), counted=False)
def spread(r: Any, half: float, slide: float, size: int) -> None:
    """Propagate the covariance of a piece: x′ = x + T/2 (v + v′), v′ = `slide` w, and the load coasts."""
    if size == SHAFT:
        _spread(r, half, slide, SHAFT)
    else:
        _spread(r, half, slide, STATES)


@njit(types.void(_mode, types.UniTuple(_f8, 4), _f8), counted=False)
def impact(r: Any, G: tuple[float, float, float, float], passed: float) -> None:
    """A contact multiplies the relative motion by G; the shaft takes a share of the change, the load the rest."""
    S, kept = r.covariance, 1.0 - passed
    for j in range(STATES):
        way, speed = S[0, j] - S[4, j], S[1, j] - S[5, j]
        more, faster = (G[0] - 1.0) * way + G[1] * speed, G[2] * way + (G[3] - 1.0) * speed
        S[0, j], S[4, j] = S[0, j] + passed * more, S[4, j] - kept * more
        S[1, j], S[5, j] = S[1, j] + passed * faster, S[5, j] - kept * faster
    for j in range(STATES):
        way, speed = S[j, 0] - S[j, 4], S[j, 1] - S[j, 5]
        more, faster = (G[0] - 1.0) * way + G[1] * speed, G[2] * way + (G[3] - 1.0) * speed
        S[j, 0], S[j, 4] = S[j, 0] + passed * more, S[j, 4] - kept * more
        S[j, 1], S[j, 5] = S[j, 1] + passed * faster, S[j, 5] - kept * faster


@njit(types.void(_mode), counted=False)
def tie(r: Any) -> None:
    """The load is in contact: its position and velocity vary with the shaft's."""
    S = r.covariance
    for j in range(STATES):
        S[4, j], S[5, j] = S[0, j], S[1, j]
    for j in range(STATES):
        S[j, 4], S[j, 5] = S[j, 0], S[j, 1]


@njit(_f8(_a, _modes, _f8, _f8, _f8, _f8, _i8, _rows, _i8), counted=False, inline=True)
def see(
    p: NDArray[Any],
    modes: NDArray[Any],
    cell: float,
    resolution: float,
    sensor: float,
    jitter: float,
    size: int,
    out: NDArray[Any],
    at: int,
) -> float:
    """Update the modes with a count; return its log-probability, and store the other results in the sample's row.

    Args:
        p: device vector.
        modes: shape (3,) of `MODE`, changed in place.
        cell: lower edge of the count's cell over the resolution.
        resolution: width of a cell [rad or m].
        sensor: standard deviation of the measurement [rad or m].
        jitter: of the sample's instant [s].
        size: of the state.
        out: rows of the samples. at: which of them.
    """
    row = out[at]
    largest = -math.inf
    row.mean = row.x = row.v = row.d = row.seen = 0.0
    for k in range(3):
        m = modes[k]
        if m.weight == 0.0:
            continue
        x = m.mean[0]
        m.expected, m.seen = x, 1.0
        if p[_ECCENTRICITY] != 0.0:
            m.expected = measured(p, x)
            m.seen = (measured(p, x + 1e-4) - measured(p, x - 1e-4)) / 2e-4
        m.covariance[0, 0] = max(m.covariance[0, 0], 0.0)  # rounding
        m.variance = m.seen * m.seen * m.covariance[0, 0] + sensor * sensor + (jitter * m.mean[1]) ** 2
        deviation = math.sqrt(m.variance)
        low = (cell * resolution - m.expected) / deviation
        m.mass, m.exponent, m.cell_mean, m.kept = truncated(low, low + resolution / deviation)
        largest = max(largest, m.exponent)
        row.mean += m.weight * m.expected
        row.seen += m.weight * m.seen
        row.x += m.weight * x
        row.v += m.weight * m.mean[1]
        row.d += m.weight * m.mean[2]
    # The prediction as one normal distribution, for the linearisation along the filter's path.
    row.variance = row.xx = row.xv = row.xd = row.vv = row.vd = row.dd = 0.0
    mass = 0.0
    for k in range(3):
        m = modes[k]
        if m.weight == 0.0:
            continue
        x, v, d = m.mean[0] - row.x, m.mean[1] - row.v, m.mean[2] - row.d
        row.variance += m.weight * (m.variance + (m.expected - row.mean) ** 2)
        row.xx += m.weight * (m.covariance[0, 0] + x * x)
        row.xv += m.weight * (m.covariance[0, 1] + x * v)
        row.xd += m.weight * (m.covariance[0, 2] + x * d)
        row.vv += m.weight * (m.covariance[1, 1] + v * v)
        row.vd += m.weight * (m.covariance[1, 2] + v * d)
        row.dd += m.weight * (m.covariance[2, 2] + d * d)
        m.mass *= m.weight * math.exp(m.exponent - largest)
        mass += m.mass
    row.gain_x, row.gain_v, row.gain_d = (
        row.seen * row.xx / row.variance,
        row.seen * row.xv / row.variance,
        row.seen * row.xd / row.variance,
    )
    probability = mass * math.exp(largest)
    outlier = OUTLIER * resolution / max(resolution, sensor)
    row.log_p = math.log(probability + outlier)
    regular = probability / (probability + outlier)
    row.moved = left = 0.0
    row.x = row.v = row.d = row.bristle = row.load_x = row.load_v = row.contact = 0.0
    for k in range(3):
        m = modes[k]
        if m.weight == 0.0:
            continue
        weight = m.mass / mass
        deviation, share = math.sqrt(m.variance), 1.0 - m.kept
        moved = deviation * m.cell_mean
        off = m.expected + moved - row.mean
        row.moved += weight * off
        left += weight * (m.variance * m.kept + off * off)
        if m.bristle_x != 0.0:  # the update does not move a bristle beyond steady sliding
            most = max(abs(m.bristle), p[_BREAKAWAY])
            m.bristle += m.bristle_x * m.seen * m.covariance[0, 0] / m.variance * moved
            m.bristle = min(max(m.bristle, -most), most)
        if size == SHAFT:
            take(m, m.seen, m.variance, share, moved, SHAFT)
        else:
            take(m, m.seen, m.variance, share, moved, STATES)
        m.weight = weight if weight > RARE else 0.0
        row.x += weight * m.mean[0]
        row.v += weight * m.mean[1]
        row.d += weight * m.mean[2]
        row.bristle += weight * m.bristle
        row.load_x += weight * m.mean[4]
        row.load_v += weight * m.mean[5]
        row.contact += weight * m.contact
    left -= row.moved * row.moved
    row.share = min(max(1.0 - left / row.variance, 0.0), 1.0)
    row.score, row.information = regular * row.moved / row.variance, regular * row.share / row.variance
    return float(row.log_p)
