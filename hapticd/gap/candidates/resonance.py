"""Where a recording shows a resonance: the inertia that the motor feels, frequency by frequency.

A load on a spring and damper makes the force that accelerates the shaft J(f)·a, with

    J(f)/J = 1 + λ (G(f) − 1),   G(s) = (2ζω s + ω²)/(s² + 2ζω s + ω²),   ω = 2π f_r,

λ the load's share of J. The measured ratio (cross-spectra of acceleration and net force; Bendat and Piersol 2010, §6)
is matched with this on a grid. A fit from anywhere else would miss a lightly damped resonance: a prediction whose load
is out of step is no better than one without a load.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import csd

from hapticd.plant.layout import word
from hapticd.plant.numeric import edited_base

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hapticd.gap.context import Context
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

_PIECE_S, _FEWEST_PIECES = 1.0, 8
_LOWEST_HZ, _HIGHEST = 1.5, 0.3
"""Band that is matched: from here to this share of the sampling rate."""
_COHERENT = 0.2
_MODEL_ERROR = 0.02
"""Relative error of the ratio that friction and the grid of stamps leave however long the recording is."""
_DAMPINGS = np.array([0.005, 0.02, 0.06, 0.2, 0.6])
_SHARES = np.arange(0.1, 0.95, 0.1)
_FREQUENCIES = 100
_APART = 1.2
"""Factor by which two resonances must differ to be two starts."""


class Resonance(NamedTuple):
    """A place on the grid."""

    f_r: float
    damping: float
    load_share: float


def resonances(context: Context, low: float, high: float, count: int) -> list[Resonance]:
    """The resonances between two frequencies that match the apparent inertia best, best first.

    Args:
        context: of the present model.
        low, high: smallest and largest f_r [Hz].
        count: at the most.
    """
    f_r = np.geomspace(low, high, _FREQUENCIES)
    misfit = np.zeros((len(f_r), len(_DAMPINGS), len(_SHARES)))
    for segment in context.segments:
        f, ratio, variance = _apparent_inertia(segment, context.base)
        for number, resonance in enumerate(f_r):
            expected = _two_masses(1j * f / resonance)
            distance = np.abs(ratio - expected) ** 2 / (np.abs(ratio) * np.abs(expected))
            misfit[number] += np.log1p(distance / variance).sum(axis=-1)
    return list(_distinct(f_r, misfit, count))


def _distinct(f_r: Floats, misfit: Floats, count: int) -> Iterator[Resonance]:
    """Best grid points, none close to a better one."""
    of_frequency = misfit.reshape(len(f_r), -1)
    taken: list[float] = []
    for number in np.argsort(of_frequency.min(axis=1)):
        if len(taken) == count:
            return
        if all(abs(np.log(f_r[number] / other)) > np.log(_APART) for other in taken):
            taken.append(float(f_r[number]))
            damping, share = np.unravel_index(int(np.argmin(of_frequency[number])), misfit.shape[1:])
            yield Resonance(float(f_r[number]), float(_DAMPINGS[damping]), float(_SHARES[share]))


def _two_masses(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """J(f)/J of every damping and share, (dampings, shares, f); s in units of ω."""
    damped = 2.0 * _DAMPINGS[:, None] * s + 1.0
    load = damped / (s**2 + damped)
    return np.asarray(1.0 + _SHARES[None, :, None] * (load[:, None] - 1.0))


def _apparent_inertia(segment: Segment, base: Floats) -> tuple[Floats, NDArray[np.complex128], Floats]:
    """Frequencies [Hz], J(f)/J and its relative variance where force and acceleration are coherent."""
    recording, period = segment.recording, segment.recording.period_s
    inertia, viscous, coulomb, torque_constant, bias, stiffness, rest = edited_base(base)
    late = round(float(base[word("delay_s")] + base[word("transport_delay.t_d")]) / period)
    current = np.roll(recording.current, late)
    around = 0.5 * (current + np.roll(current, 1))
    acceleration = np.zeros(recording.rows)
    acceleration[1:-1] = np.diff(recording.position, 2) / period**2
    pulled = bias - stiffness * (segment.smooth - rest)
    force = torque_constant * around + pulled - viscous * segment.velocity - coulomb * np.sign(segment.velocity)
    # A shaft that may be at rest says nothing: stiction takes what it needs.
    still = np.abs(segment.velocity) * segment.length * period < 3.0 * segment.resolution
    force = np.where(still, inertia * acceleration, force)
    size = min(round(_PIECE_S / period), recording.rows // _FEWEST_PIECES)
    spectrum = partial(csd, fs=1.0 / period, nperseg=size, detrend=False)
    f, cross = spectrum(acceleration, force)
    forces, accelerations = (np.real(spectrum(signal, signal)[1]) for signal in (force, acceleration))
    used = (f > _LOWEST_HZ) & (f < _HIGHEST / period) & (forces > 0.0) & (accelerations > 0.0) & (np.abs(cross) > 0.0)
    cross, forces, accelerations = cross[used], forces[used], accelerations[used]
    coherence = np.minimum(np.abs(cross) ** 2 / (forces * accelerations), 0.999)
    ratio = cross / np.abs(cross) * np.sqrt(forces / accelerations) / inertia
    pieces = 2 * recording.rows // size
    variance = (1.0 - coherence) / np.maximum(coherence, 1e-9) / pieces + _MODEL_ERROR**2
    clear = coherence > _COHERENT
    return f[used][clear], ratio[clear], variance[clear]
