"""The stochastic filter behind every number of the workflow: how likely is each encoder count, given those before it?

State: position x, velocity v, and a disturbance torque d that no catalogue knows,

    dx = v dt,   m dv = (K_t i + f_θ(x, v, i, t) + d) dt + σ dW,   dd = −d/τ dt + s √(2/τ) dW′,   count = ⌊(h(x) + r e)/Δ⌋.

Prediction moves a few Gauss–Hermite points through the project's own exact plant (`hapticd.plant.numeric.substep`), so every
law of the catalogue is in the filter as it stands. The points lie along w = v + (T/m) d, the direction that decides whether
friction holds the shaft; across it the state is carried linearly. The load behind a play is part of the state
(`hapticd.gap.kernel.load`); a bristle, and the load behind a coupling, are taken to be known as well as the filtered path.

The measurement is the probability of the encoder's cell, its update the moments of the normal truncated to that cell
(grey-box identification: Kristensen, Madsen and Jørgensen, Automatica 40, 2004; latent force: Rogers and Friis,
arXiv 2109.10681).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types

from hapticd.gap.kernel.cell import truncated
from hapticd.gap.kernel.load import carry, see, spread_along, tie
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, SENSOR, TICK, WHITE
from hapticd.jit import njit
from hapticd.plant.coupled import Coupling, is_underdamped, swing_apart
from hapticd.plant.effect_terms import shared_inertia
from hapticd.plant.exact import propagate
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA
from hapticd.plant.layout import index_of as word
from hapticd.plant.numeric import edited_base, measured, needs_effect_terms, substep

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_i8 = types.int64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")
_rows = types.Array(from_dtype(TICK), 1, "C")
_flags = types.Array(types.boolean, 1, "C")

OUTLIER = 1e-3 / 64.0
"""Probability of an arbitrary count: what a gross outlier costs at most."""
_POINTS = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
_WEIGHTS = np.array([1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0])
_CERTAIN = 5.0
"""Standard deviations of the velocity that must lie on one side of standstill for one point to do."""

_FARTHEST_TWIST = 1.0
"""Twist of a coupling [rad or m] beyond which the load is put back to the shaft."""

_EXTERNAL = word("external_force")
_GAP = word("backlash.gap")
_GAP_SHARE = word("backlash.load_share")
_RESTITUTION = word("backlash.restitution")
_RESONANCE = word("flexible_coupling.f_r")
_RESONANCE_SHARE = word("flexible_coupling.load_share")
_ECCENTRICITY = word("encoder_eccentricity.e")
_BREAKAWAY = word("presliding.breakaway")
_TORQUE_CONSTANT = word("torque_constant")
_RESONANCE_DAMPING = word("flexible_coupling.damping")


@njit(_f8(_a, _f8), counted=False)
def moving_inertia(p: NDArray[Any], contact: float) -> float:
    """Return the inertia that a torque on the shaft accelerates at once."""
    inertia = edited_base(p)[0]
    if p[_GAP] > 0.0 and contact == 0.0:
        inertia -= shared_inertia(p, p[_GAP_SHARE])
    if p[_RESONANCE] < math.inf:
        inertia -= shared_inertia(p, p[_RESONANCE_SHARE])
    return inertia


@njit(_f8(_a, _a, _f8, _a, _a, _m, _m, _m, _flags, _rows))
def run_filter(
    p: NDArray[Any],
    noise: NDArray[Any],
    resolution: float,
    time_s: NDArray[Any],
    cell: NDArray[Any],
    duration: NDArray[Any],
    current: NDArray[Any],
    spread: NDArray[Any],
    begins: NDArray[Any],
    out: NDArray[Any],
) -> float:
    """Filter recordings and return the log-likelihood.

    Args:
        p: device vector, shape (SIZE,); its external force is used as scratch.
        noise: shape (5,), in the order of `NOISE`.
        resolution: width of a cell [rad or m], > 0.
        time_s: instants of the n samples [s].
        cell: lower edge of each sample's cell over the resolution.
        duration: of the parts of each period [s], shape (n, parts).
        current: motor current in them [A], shape (n, parts).
        spread: standard deviation of that current [A], shape (n, parts): commands that may have been lost.
        begins: whether a sample is the first of a stretch, whose state nothing before it tells.
        out: shape (n,) of `TICK`.
    """
    n, parts = current.shape
    white, sensor, jitter = noise[WHITE], noise[SENSOR], noise[JITTER]
    disturbance, tau = noise[DISTURBANCE], noise[CORRELATION]
    sd2 = disturbance * disturbance
    simple = not needs_effect_terms(p) and edited_base(p)[5] == 0.0
    remembers = p[_GAP] > 0.0 or p[_RESONANCE] < math.inf or p[_BREAKAWAY] > 0.0
    p[_EXTERNAL] = 0.0
    inertia, viscous, coulomb, torque_constant, bias, stiffness, _ = edited_base(p)
    natural = 2.0 * math.pi * p[_RESONANCE]
    far = shared_inertia(p, p[_RESONANCE_SHARE])
    load = Coupling(far, far / (inertia - far), p[_RESONANCE_DAMPING] * natural, natural * natural)
    swings = p[_RESONANCE] < math.inf and p[_GAP] == 0.0 and p[_BREAKAWAY] == 0.0
    swings = swings and is_underdamped(load.ratio, p[_RESONANCE_DAMPING])
    remembered = np.zeros(STATE)
    state = np.zeros(STATE)
    xs, vs, ds = np.zeros(3), np.zeros(3), np.zeros(3)
    bristles, load_xs, load_vs = np.zeros(3), np.zeros(3), np.zeros(3)
    x = v = d = 0.0
    xx = xv = xd = vv = vd = dd = 0.0
    total = 0.0
    bristle_x = load_x_x = load_v_v = 0.0
    has_play = p[_GAP] > 0.0
    C, P = np.zeros((2, 3)), np.zeros((2, 2))
    along, across = np.zeros(5), np.zeros(5)
    passed = shared_inertia(p, p[_GAP_SHARE]) / inertia
    for i in range(n):
        if begins[i]:
            last = min(i + 5, n - 1)
            for k in range(i + 1, last + 1):
                if begins[k]:
                    last = k - 1
                    break
            x = (cell[i] + 0.5) * resolution
            span = time_s[last] - time_s[i] if last > i else 1.0
            v = (cell[last] - cell[i]) * resolution / span
            vv = (2.0 * resolution / span) ** 2 + v * v + (span * coulomb / inertia) ** 2
            d = xv = xd = vd = 0.0
            xx, dd = resolution * resolution + sensor * sensor, sd2
            remembered[:] = 0.0
            remembered[LOAD_THETA], remembered[LOAD_OMEGA] = x, v
            bristle_x = load_x_x = load_v_v = 0.0
            if has_play:
                tie(C, P, xx, xv, xd, vv, vd)
                P[0, 0] += p[_GAP] * p[_GAP] / 12.0
        row = out[i]
        seen = 1.0
        expected = x
        if p[_ECCENTRICITY] != 0.0:
            expected = measured(p, x)
            seen = (measured(p, x + 1e-4) - measured(p, x - 1e-4)) / 2e-4
        variance = seen * seen * xx + sensor * sensor + (jitter * v) ** 2
        deviation = math.sqrt(variance)
        low = (cell[i] * resolution - expected) / deviation
        log_mass, mean, kept = truncated(low, low + resolution / deviation)
        mass = math.exp(log_mass)
        log_p = math.log(mass + OUTLIER)
        total += log_p
        share = 1.0 - kept
        row.log_p, row.mean, row.variance, row.share = log_p, expected, variance, share
        regular = mass / (mass + OUTLIER)
        row.score, row.information, row.seen = regular * mean / deviation, regular * share / variance, seen
        row.moved = deviation * mean
        row.xx, row.xv, row.xd, row.vv, row.vd, row.dd = xx, xv, xd, vv, vd, dd
        gx, gv, gd = seen * xx / variance, seen * xv / variance, seen * xd / variance
        row.gain_x, row.gain_v, row.gain_d = gx, gv, gd
        taken = variance * share
        moved = deviation * mean
        x += gx * moved
        v += gv * moved
        d += gd * moved
        xx -= gx * gx * taken
        xv -= gx * gv * taken
        xd -= gx * gd * taken
        vv -= gv * gv * taken
        vd -= gv * gd * taken
        dd -= gd * gd * taken
        remembered[BRISTLE] += bristle_x * gx * moved
        if has_play:
            load_gain_x, load_gain_v = see(C, P, seen, variance, share, gx, gv, gd)
            remembered[LOAD_THETA] += load_gain_x * moved
            remembered[LOAD_OMEGA] += load_gain_v * moved
            if remembered[CONTACT] != 0.0:
                remembered[LOAD_THETA] = x - 0.5 * remembered[CONTACT] * p[_GAP]
                remembered[LOAD_OMEGA] = v
        elif remembers:
            remembered[LOAD_THETA] += load_x_x * gx * moved
            remembered[LOAD_OMEGA] += load_v_v * gv * moved
        row.x, row.v, row.d = x, v, d
        row.bristle, row.load_x, row.load_v = remembered[BRISTLE], remembered[LOAD_THETA], remembered[LOAD_OMEGA]
        row.contact = remembered[CONTACT]
        if i + 1 == n or begins[i + 1]:
            row.next_v = v
            row.x_v = row.v_v = row.x_d = row.v_d = row.d_d = row.x_force = row.v_force = 0.0
            continue
        period = time_s[i + 1] - time_s[i]
        moving = moving_inertia(p, remembered[CONTACT]) if remembers else inertia
        ratio = period / tau
        decay = math.exp(-ratio)
        mean_d = (1.0 - decay) / ratio if ratio > 1e-6 else 1.0
        push = mean_d * period / moving  # velocity that a unit of d gives in the period
        ww = max(vv + 2.0 * push * vd + push * push * dd, 1e-30)
        sw = math.sqrt(ww)
        cx, cv, cd = (xv + push * xd) / ww, (vv + push * vd) / ww, (vd + push * dd) / ww
        rxx, rxv, rxd = max(xx - cx * cx * ww, 0.0), xv - cx * cv * ww, xd - cx * cd * ww
        rvv, rvd, rdd = max(vv - cv * cv * ww, 0.0), vd - cv * cd * ww, max(dd - cd * cd * ww, 0.0)
        if has_play:
            along[0], along[1], along[2] = cx, cv, cd
            along[3], along[4] = (C[0, 1] + push * C[0, 2]) / ww, (C[1, 1] + push * C[1, 2]) / ww
        contact = 0.0
        # Friction is kinked at standstill. Where the shaft surely keeps moving, the step is as good as linear.
        largest = 0.0
        for j in range(parts):
            largest = max(largest, abs(current[i, j]))
        torque = 4.0 * coulomb + torque_constant * largest + abs(d) + 4.0 * viscous * abs(v)
        if swings:
            twist, twist_rate = remembered[LOAD_THETA] - x, remembered[LOAD_OMEGA] - v
            torque += load.inertia * (load.stiffness * abs(twist) + 2.0 * load.damping * abs(twist_rate))
        certain = (swings or not remembers) and abs(v) > torque * period / moving + _CERTAIN * sw
        for k in range(3):
            if certain and k != 1:
                continue
            reach = _POINTS[k] * sw
            xk, vk, dk = x + reach * cx, v + reach * cv, d + reach * cd
            force = mean_d * dk
            if simple:
                for j in range(parts):
                    drive = torque_constant * current[i, j] + bias + force
                    xk, vk = propagate(xk, vk, duration[i, j], drive, inertia, viscous, coulomb)
                xs[k], vs[k] = xk, vk
            else:
                for j in range(STATE):
                    state[j] = remembered[j]
                state[THETA], state[OMEGA] = xk, vk
                p[_EXTERNAL] = force
                if has_play:
                    state[LOAD_THETA] += reach * along[3]
                    state[LOAD_OMEGA] += reach * along[4]
                    if state[CONTACT] != 0.0:
                        state[LOAD_THETA], state[LOAD_OMEGA] = xk - 0.5 * state[CONTACT] * p[_GAP], vk
                now = time_s[i]
                for j in range(parts):
                    if duration[i, j] > 0.0:
                        substep(p, state, now, duration[i, j], current[i, j])
                        now += duration[i, j]
                xs[k], vs[k] = state[THETA], state[OMEGA]
                bristles[k], load_xs[k], load_vs[k] = state[BRISTLE], state[LOAD_THETA], state[LOAD_OMEGA]
                if k == 1:
                    contact = state[CONTACT]
            ds[k] = decay * dk
        if certain:
            slope_v = math.exp(-viscous * period / inertia)
            slope_x = 0.5 * period * (1.0 + slope_v)
            apart_x, apart_v = cx + slope_x * cv + 0.5 * slope_x * push * cd, slope_v
            load_x = load_v = 0.0
            if swings:
                apart_x, apart_v, load_x, load_v = swing_apart(
                    period, cx, cv, mean_d * cd / moving, viscous / moving, stiffness / moving, load
                )
            for k in (0, 2):
                reach = _POINTS[k] * sw
                xs[k], vs[k] = xs[1] + reach * apart_x, vs[1] + reach * apart_v
                bristles[k] = bristles[1]
                load_xs[k], load_vs[k] = load_xs[1] + reach * load_x, load_vs[1] + reach * load_v
                ds[k] = ds[1] + decay * reach * cd
        x = v = 0.0
        for k in range(3):
            x += _WEIGHTS[k] * xs[k]
            v += _WEIGHTS[k] * vs[k]
        d *= decay
        row.next_v = v
        x_v = v_v = 0.0
        for k in range(3):
            x_v += _WEIGHTS[k] * _POINTS[k] * xs[k] / sw
            v_v += _WEIGHTS[k] * _POINTS[k] * vs[k] / sw
        v_force = v_v * period / moving
        half = 0.5 * period * v_v
        x_v += half * (1.0 - cv) - cx  # along w, and across it
        row.x_v, row.v_v, row.x_d, row.v_d, row.d_d = x_v, v_v, half * push, v_v * push, decay
        row.x_force, row.v_force = 0.5 * period * v_force, v_force
        q = white * white * period / (moving * moving)
        for j in range(parts):
            lost = torque_constant * spread[i, j] * duration[i, j] / moving
            q += lost * lost
        free = v_v / moving
        qd = 2.0 * sd2 / tau * free * free
        # Across w: x keeps what it does not share with w, v′ depends on w alone, d decays.
        xx = rxx + 2.0 * half * rxv + half * half * rvv + q * period * period / 3.0 + qd * period**5 / 20.0
        xv = q * period / 2.0 + qd * period**4 / 8.0
        vv = q + qd * period**3 / 3.0
        drift = 2.0 * sd2 / tau * free
        xd = decay * (rxd + half * rvd) + drift * period**3 / 6.0
        vd = drift * period * period / 2.0
        dd = decay * decay * rdd + sd2 * (1.0 - decay * decay)
        if has_play:
            across[0], across[1], across[2], across[3], across[4] = rxx, rxv, rxd, rvv, rvd
            met = remembered[CONTACT] == 0.0 and load_vs[1] != remembered[LOAD_OMEGA]
            bounce = (1.0 if contact != 0.0 else 1.0 + p[_RESTITUTION]) if met else 0.0
            more = carry(C, P, along, across, ww, period, decay, half, bounce * passed, bounce * (1.0 - passed))
            xx, xv, xd, vv, vd = xx + more[0], xv + more[1], xd + more[2], vv + more[3], vd + more[4]
        spread_x = spread_v = 0.0
        for k in range(3):
            ex, ev, ed = xs[k] - x, vs[k] - v, ds[k] - d
            weight = _WEIGHTS[k]
            xx += weight * ex * ex
            xv += weight * ex * ev
            xd += weight * ex * ed
            vv += weight * ev * ev
            vd += weight * ev * ed
            dd += weight * ed * ed
            spread_x += weight * ex * ex
            spread_v += weight * ev * ev
        if remembers:
            mean_b = mean_x = mean_v = 0.0
            for k in range(3):
                mean_b += _WEIGHTS[k] * bristles[k]
                mean_x += _WEIGHTS[k] * load_xs[k]
                mean_v += _WEIGHTS[k] * load_vs[k]
            if has_play:
                spread_along(C, P, _WEIGHTS, xs, vs, ds, load_xs, load_vs, x, v, d, mean_x, mean_v)
                if contact != 0.0:
                    tie(C, P, xx, xv, xd, vv, vd)
            bristle_x = load_x_x = load_v_v = 0.0
            for k in range(3):
                bristle_x += _WEIGHTS[k] * (bristles[k] - mean_b) * (xs[k] - x)
                load_x_x += _WEIGHTS[k] * (load_xs[k] - mean_x) * (xs[k] - x)
                load_v_v += _WEIGHTS[k] * (load_vs[k] - mean_v) * (vs[k] - v)
            bristle_x /= max(spread_x, 1e-300)
            load_x_x /= max(spread_x, 1e-300)
            load_v_v /= max(spread_v, 1e-300)
            if p[_RESONANCE] < math.inf and abs(mean_x - x) > _FARTHEST_TWIST:
                mean_x, mean_v = x, v  # a coupling that no data would have: it must not cost what its swing would
            remembered[BRISTLE], remembered[LOAD_THETA], remembered[LOAD_OMEGA] = mean_b, mean_x, mean_v
            remembered[CONTACT] = contact
    p[_EXTERNAL] = 0.0
    return total
