"""One period of the filter: a mode is divided where friction decides, and each piece is moved by the exact plant.

The decisive quantity is the velocity w that the shaft would have after a period T if only the disturbance d acted, without
friction and the other forces. With the sum F of the other forces and a stiction c it moves up if w > (c − F) T/m, down if
w < (−c − F) T/m, and is at rest in between. Pieces with the same next mode are one group; the plant moves its mean, and its
covariance is propagated linearly.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import from_dtype, types

from hapticd.gap.kernel._springy import blurred, touch
from hapticd.gap.kernel.cell import lower_tail
from hapticd.gap.kernel.device import FARTHEST_TWIST, LAWS, PERIOD, coupling_of, loosen, moving_inertia
from hapticd.gap.kernel.modes import DOWN, HELD, MODE, RARE, STATES, STOPPED, UP, W, impact, join, spread, tie
from hapticd.jit import njit
from hapticd.plant.exact import propagate
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA, index_of
from hapticd.plant.numeric import holding, substep
from hapticd.plant.springy_contact import push_of
from hapticd.plant.two_masses import restitution_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_i8 = types.int64
_a = types.Array(_f8, 1, "C")

_EXTERNAL = index_of("external_force")
_GAP = index_of("backlash.gap")

_law, _period, _mode = from_dtype(LAWS), from_dtype(PERIOD), from_dtype(MODE)
_laws, _periods = types.Array(_law, 1, "C"), types.Array(_period, 1, "C")
_modes = types.Array(from_dtype(MODE), 1, "C")

_LEAST = 1e-12
"""Smallest share of the variance of w that remains between the two limits of stiction: less is rounding."""


@njit(types.void(_a, _law, _period, _a, _a, _a, _f8, _f8, _f8), counted=False, inline=True)
def _go(
    p: NDArray[Any],
    law: Any,
    period: Any,
    duration: NDArray[Any],
    current: NDArray[Any],
    state: NDArray[Any],
    x: float,
    v: float,
    torque: float,
) -> None:
    """Move the plant through a period with an additional torque; its memory is in `state`, changed in place."""
    if law.simple:
        for j in range(len(current)):
            drive = law.torque_constant * current[j] + law.bias + torque
            x, v = propagate(x, v, duration[j], drive, law.inertia, law.viscous, law.coulomb)
        state[THETA], state[OMEGA] = x, v
        return
    state[THETA], state[OMEGA] = x, v
    p[_EXTERNAL] = torque
    now = period.time
    for j in range(len(current)):
        if duration[j] > 0.0:
            substep(p, state, now, duration[j], current[j])
            now += duration[j]
    p[_EXTERNAL] = 0.0


@njit(types.void(_mode, _period, _f8), counted=False, reorder=True)
def _swing(r: Any, period: Any, share: float) -> None:
    """Propagate the covariance of a piece with a load on a coupling; the shaft makes a `share`, 0 to 1, of its motion."""
    S, M = r.covariance, period.now
    for k in range(4):
        for j in range(5):
            M[k, j] = share * period.moving[k, j] + (1.0 - share) * period.held[k, j]
    for j in range(STATES):
        x, v, w, load_x, load_v = S[0, j], S[1, j], S[W, j], S[4, j], S[5, j]
        for k in range(4):
            moved = M[k, 0] * x + M[k, 1] * v + M[k, 2] * w + M[k, 3] * load_x + M[k, 4] * load_v
            S[k if k < 2 else k + 2, j] = moved
    for j in range(STATES):
        x, v, w, load_x, load_v = S[j, 0], S[j, 1], S[j, W], S[j, 4], S[j, 5]
        for k in range(4):
            moved = M[k, 0] * x + M[k, 1] * v + M[k, 2] * w + M[k, 3] * load_x + M[k, 4] * load_v
            S[j, k if k < 2 else k + 2] = moved


@njit(types.void(_a, _laws, _periods, _a, _a, _modes, _i8, _modes), counted=False, inline=True)
def cut(
    p: NDArray[Any],
    laws: NDArray[Any],
    periods: NDArray[Any],
    duration: NDArray[Any],
    current: NDArray[Any],
    modes: NDArray[Any],
    mode: int,
    groups: NDArray[Any],
) -> None:
    """Divide a mode at the limits of w, and merge each piece with those of the same next mode.

    Args:
        p: device vector.
        laws: one of `LAWS`. periods: one of `PERIOD`.
        duration: of the parts of the period [s]. current: of each part [A].
        modes: shape (3,) of `MODE`. mode: index of the one to divide, which is overwritten.
        groups: pieces of all modes, shape (4,): held, up, down, and stopped.
    """
    law, period, m = laws[0], periods[0], modes[mode]
    inertia = moving_inertia(p, m.contact) if law.size == STATES else law.inertia
    unit = period.span / inertia
    push = period.mean * unit
    x, v = m.mean[0], m.mean[1]
    strain = 0.0
    if law.has_coupling:
        to = coupling_of(p)
        strain = to.inertia * (to.stiffness * (m.mean[4] - x) + 2.0 * to.damping * (m.mean[5] - v))
    if law.is_springy:
        strain = -push_of(p, x - m.mean[4], v - m.mean[5])
    most, least, mean, stiction = -math.inf, math.inf, strain, law.coulomb
    for j in range(len(current)):
        if duration[j] > 0.0:
            pull = law.torque_constant * current[j] + law.bias
            if not law.simple:
                pull, stiction = holding(p, x, period.time + 0.5 * period.span, current[j])
            most, least = max(most, pull + strain), min(least, pull + strain)
            mean += pull * duration[j] / period.span
    if mode != HELD:  # the whole period stops a moving shaft; its strongest part releases a held one
        most = least = mean
    for j in range(law.size):
        m.gain[j] = m.covariance[j, 1] + push * m.covariance[j, 2]
    ww = max(m.gain[1] + push * m.gain[2] + (period.white + period.coloured) / (inertia * inertia), 1e-30)
    m.gain[2] = period.decay * m.gain[2] + period.fresh / inertia
    m.gain[W] = ww
    for j in range(law.size):
        m.gain[j] /= ww
    sw = math.sqrt(ww)
    w = v + push * m.mean[2]
    # State at the start of a piece: x and v at present, d at the end of the period, and w.
    for j in range(law.size):
        m.covariance[2, j] *= period.decay
    for j in range(law.size):
        m.covariance[j, 2] *= period.decay
    for j in range(law.size):
        m.covariance[j, W] = m.covariance[W, j] = m.gain[j] * ww
    m.covariance[2, 2] += period.renewed
    m.mean[2] *= period.decay
    m.mean[W] = w
    if stiction <= 0.0:
        join(groups[UP], m, m.weight, 0.0, 0.0, law.size)
        return
    below, above = ((-stiction - least) * unit - w) / sw, ((stiction - most) * unit - w) / sw
    falls, density_below = lower_tail(below)
    rises, density_above = lower_tail(-above)
    stays = 1.0 - falls - rises
    stop = HELD if mode == HELD else STOPPED
    if m.weight * stays > RARE:
        shift = (density_below - density_above) / stays
        left = 1.0 + (below * density_below - above * density_above) / stays - shift * shift
        join(groups[stop], m, m.weight * stays, shift * sw, ww * (1.0 - max(left, _LEAST)), law.size)
    if m.weight * rises > RARE:
        shift = density_above / rises
        join(groups[UP], m, m.weight * rises, shift * sw, ww * (shift * shift - above * shift), law.size)
    if m.weight * falls > RARE:
        shift = -density_below / falls
        join(groups[DOWN], m, m.weight * falls, shift * sw, ww * (shift * shift - below * shift), law.size)


@njit(_i8(_a, _laws, _periods, _a, _a, _modes, _i8, _a, _a), counted=False, inline=True)
def carry(
    p: NDArray[Any],
    laws: NDArray[Any],
    periods: NDArray[Any],
    duration: NDArray[Any],
    current: NDArray[Any],
    groups: NDArray[Any],
    to_mode: int,
    state: NDArray[Any],
    other: NDArray[Any],
) -> int:
    """Propagate a group of pieces over a period, its mean with the plant; return its next mode."""
    law, period, r = laws[0], periods[0], groups[to_mode]
    if to_mode == HELD and not law.remembers:
        return HELD
    inertia = moving_inertia(p, r.contact) if law.size == STATES else law.inertia
    unit, half = period.span / inertia, 0.5 * period.span
    x, v, before = r.mean[0], r.mean[1], r.contact
    state[BRISTLE], state[CONTACT] = r.bristle, before
    state[LOAD_THETA], state[LOAD_OMEGA] = x, v
    if law.size == STATES:
        state[LOAD_THETA], state[LOAD_OMEGA] = r.mean[4], r.mean[5]
        if before != 0.0 and not law.is_springy:
            state[LOAD_THETA], state[LOAD_OMEGA] = x - 0.5 * before * p[_GAP], v
    if law.has_bristle:
        for j in range(STATE):
            other[j] = state[j]
    load_v = state[LOAD_OMEGA]
    more = closed = 0.0
    if law.is_springy:
        more, closed = blurred(p, r, 0.5 * (v + r.mean[W]), period.span)
    _go(p, law, period, duration, current, state, x, v, (r.mean[W] - v) / unit - more)
    ends = HELD if to_mode == STOPPED else to_mode
    if not law.has_bristle:
        ends = UP if state[OMEGA] > 0.0 else DOWN if state[OMEGA] < 0.0 else HELD
    slide = 0.0
    if ends != HELD:
        slide = math.exp(-law.viscous * period.span / inertia) if law.size == STATES else period.coast
    r.bristle_x = 0.0
    if law.has_bristle:
        step = math.sqrt(r.covariance[W, W])
        along_x, along_v = r.covariance[0, W] / step, r.covariance[1, W] / step
        if to_mode == DOWN:
            along_x, along_v, step = -along_x, -along_v, -step
        torque = (r.mean[W] - v + step - along_v) / unit
        _go(p, law, period, duration, current, other, x + along_x, v + along_v, torque)
        slide = min(max((other[OMEGA] - state[OMEGA]) / step, 0.0), 2.0)
        far = other[THETA] - state[THETA]
        if far * step > 0.0:
            r.bristle_x = (other[BRISTLE] - state[BRISTLE]) / far
    if law.has_coupling:
        share = min(slide / period.moving[1, 2], 1.0) if law.has_bristle else 1.0 if ends != HELD else 0.0
        _swing(r, period, share)
        slide = max(r.covariance[1, W] / r.covariance[W, W], 0.0)
    else:
        spread(r, half, slide, law.size)
    # Effect of the white force on the position beyond T/2 times its effect on the velocity.
    r.covariance[0, 0] += period.white / 12.0 * (slide * period.span / inertia) ** 2
    r.mean[0], r.mean[1], r.bristle = state[THETA], state[OMEGA], state[BRISTLE]
    if law.has_play:
        r.contact, r.mean[4], r.mean[5] = state[CONTACT], state[LOAD_THETA], state[LOAD_OMEGA]
        if law.is_springy:
            touch(p, law, period, r, more, closed, 1.0 if slide > 0.0 else 0.0)
            slide = max(r.covariance[1, W] / r.covariance[W, W], 0.0)
        else:
            if before == 0.0 and state[LOAD_OMEGA] != load_v:
                left = 0.0 if r.contact != 0.0 else -restitution_of(p)
                impact(r, (left, 0.0, 0.0, left), law.passed)
            if r.contact != 0.0:
                tie(r)
    if law.has_coupling:
        r.mean[4], r.mean[5] = state[LOAD_THETA], state[LOAD_OMEGA]
        if abs(r.mean[4] - r.mean[0]) > FARTHEST_TWIST:
            r.mean[4], r.mean[5] = r.mean[0], r.mean[1]  # that no data would have: it must not cost what it would
            loosen(law, r)
    period.slide += r.weight * slide
    if slide > 0.0:
        period.moves += r.weight
    return ends
