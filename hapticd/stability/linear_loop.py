"""The linear sampled loop, without ticks and Coulomb friction: its stability boundary, and its impedance at the hand.

**Boundary** (T. Hulin, C. Preusche, G. Hirzinger, "Stability boundary for haptic rendering: influence of physical damping",
IROS 2006; with delay: T. Hulin, A. Albu-Schäffer, G. Hirzinger, "Passivity and stability boundaries for haptic systems with
time delay", IEEE Trans. Control Systems Technology 22, 2014). Device and arm are m, b and k in parallel; the force of
H(z) = K + B D(z) is held for a period and arrives T_D late, any fraction of a period included. With the motion of one period
x' = A x + Γ₁ f(k−⌊τ_D⌋−1) + Γ₀ f(k−⌊τ_D⌋), exact by the matrix exponential (the modified z-transform), the loop is stable if

    q(z) = z⁻² det(zI − A) + z⁻² (1 0) adj(zI − A) (Γ₁ z⁻¹ + Γ₀) z^(−⌊τ_D⌋) H(z)

has no zero on or outside the unit circle. q is analytic there and 1 at infinity, so by the argument principle it is
sufficient that its winding number around 0 is zero as z goes around the circle: a sum of angles, for any length of the
velocity window.

**Impedance** (J. E. Colonnese, A. F. Siu, C. M. Abbott, A. M. Okamura, "Rendered and characterized closed-loop accuracy of
impedance-type haptic displays", IEEE Trans. Haptics 8, 2015). For a hand that moves the device by x = X e^(jωt) it is, up
to half the servo rate, Z(jω) = mjω + b + H(e^(jωT)) · hold · e^(−jωT_D)/(jω), with the stiffness K_eff = Re jωZ and the
damping B_eff = Re Z; at low frequency they are K and b + B − K(T/2 + T_D).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from hapticd.stability.numbers import Loop
    from hapticd.stability.storage import FloatArray

VelocityFilter = tuple[int, float]
"""Periods of the difference, and the decay of the low-pass per period: `hapticd.stability.damping.velocity_filter`."""
ComplexArray = NDArray[np.complex128]

#: Angles on the half circle: number near 0, number evenly spaced, and additional ones for each period of memory.
_SLOW, _EVEN, _EACH = 300, 1200, 12
#: K in units of m/T², and bisection steps in the first interval with the boundary.
_SEARCHED: Final = np.geomspace(1e-6, 8.0, 64)
_HALVINGS: Final = 40


def _rendered(z: ComplexArray, period: float, velocity: VelocityFilter) -> ComplexArray:
    """D(z): transfer function from position to velocity estimate, in 1/s."""
    window, keep = velocity
    return np.asarray((1.0 - keep) / (1.0 - keep / z) * (1.0 - z**-window) / (window * period))


def _characteristic(loop: Loop, velocity: VelocityFilter) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """The terms of q = q₀ + K q₁ + B q₂ at angles from 0 to π."""
    from scipy.linalg import expm

    T, m = loop.period, loop.inertia
    whole = math.floor(loop.delay / T)
    late = loop.delay / T - whole
    angles = _EVEN + _EACH * (whole + velocity[0])
    theta = np.concatenate([[0.0], np.geomspace(1e-6, 0.02, _SLOW), np.linspace(0.02, math.pi, angles)[1:]])
    z = np.exp(1j * theta)
    # state in units of position and displacement per period, for a good condition number
    flow = np.array([[0.0, 1.0, 0.0], [-loop.hand_stiffness * T * T / m, -loop.viscous * T / m, T * T / m], [0.0] * 3])
    before, after = expm(late * flow), expm((1.0 - late) * flow)
    A = after[:2, :2] @ before[:2, :2]
    force = np.outer(after[:2, :2] @ before[:2, 2], 1.0 / z) + after[:2, 2][:, None]
    bare = (z * z - np.trace(A) * z + np.linalg.det(A)) / z**2
    pushed = ((z - A[1, 1]) * force[0] + A[0, 1] * force[1]) * z ** -(whole + 2.0)
    return bare, pushed, pushed * _rendered(z, T, velocity)


def _stable(terms: tuple[ComplexArray, ComplexArray, ComplexArray], K: FloatArray, B: FloatArray) -> NDArray[np.bool_]:
    """Whether the loop is stable; K and B (n,)."""
    q = terms[0] + K[:, None] * terms[1] + B[:, None] * terms[2]
    return np.asarray(np.abs(np.angle(q[:, 1:] * q[:, :-1].conj()).sum(axis=1)) < 0.5 * math.pi)


def largest_stable(loop: Loop, velocity: VelocityFilter, damping: FloatArray) -> FloatArray:
    """The boundary: the K up to which the linear loop is stable with each B, 0 if with none.

    Args:
        loop: in SI units, with an arm in parallel; its stiffness and damping are not used.
        velocity: the estimate used for B. damping: (n,) B in N m s/rad or N s/m.
    """
    terms = _characteristic(loop, velocity)
    unit = loop.inertia / loop.period**2 * (1.0 + loop.viscous * loop.period / loop.inertia)
    low, high = np.zeros_like(damping), np.full_like(damping, np.inf)
    for K in (unit * _SEARCHED).tolist():
        rising = np.isinf(high)
        stable = _stable(terms, np.full(int(rising.sum()), K), damping[rising])
        low[rising], high[rising] = np.where(stable, K, low[rising]), np.where(stable, np.inf, K)
    high = np.where(np.isinf(high), low, high)
    found = low > 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        stable = _stable(terms, middle, damping)
        low, high = np.where(stable, middle, low), np.where(stable, high, middle)
    return np.where(found, low, 0.0)


def largest_damping(loop: Loop, velocity: VelocityFilter) -> float:
    """The B up to which some stiffness is stable, to 0.1 %; 0 if none is."""
    unit = loop.inertia / loop.period + loop.viscous
    damping = np.append(0.0, unit * np.geomspace(1e-3, 8.0, 64))
    stable = np.flatnonzero(largest_stable(loop, velocity, damping))
    if stable.size == 0:
        return 0.0
    low, high = damping[stable[-1]], damping[min(stable[-1] + 1, damping.size - 1)]
    fine = np.linspace(low, high, 64)
    return float(fine[np.flatnonzero(largest_stable(loop, velocity, fine))[-1]])


def impedance(loop: Loop, velocity: VelocityFilter, hertz: FloatArray) -> ComplexArray:
    """Impedance Z of the closed loop at the hand, force over velocity; in N m s/rad or N s/m.

    Args:
        loop: the device in SI units, without the hand. velocity: the estimate used for its B.
        hertz: (n,) frequencies above 0, up to half the servo rate.
    """
    s = 2j * math.pi * np.asarray(hertz, dtype=np.float64)
    z = np.exp(s * loop.period)
    hold = (1.0 - 1.0 / z) / (s * loop.period) * np.exp(-s * loop.delay)
    rendered = (loop.stiffness + loop.damping * _rendered(z, loop.period, velocity)) * hold
    return np.asarray(loop.inertia * s + loop.viscous + (rendered + loop.hand_stiffness) / s)


def effective(loop: Loop, velocity: VelocityFilter, hertz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """K_eff and B_eff at frequencies, as for `impedance`: in N m/rad or N/m, and N m s/rad or N s/m."""
    Z = impedance(loop, velocity, hertz)
    return np.asarray(-2.0 * math.pi * hertz * Z.imag), np.asarray(Z.real)
