"""Results of the filter for one sample, and the names of the noise parameters."""

from __future__ import annotations

import numpy as np

TICK = np.dtype(
    [
        ("log_p", "f8"),  # log probability of the count
        ("mean", "f8"),  # predicted measurement [rad or m]
        ("variance", "f8"),  # of the measurement before quantisation
        ("share", "f4"),  # of the variance that the count removes; 1 for a measurement without a cell
        ("score", "f4"),  # d log_p / d mean
        ("information", "f4"),  # −d score / d mean, expected
        ("moved", "f4"),  # mean of the measurement given its cell, minus `mean`
        ("seen", "f4"),  # d measurement / d x
        ("gain_x", "f4"),  # regression of the state on the measurement
        ("gain_v", "f4"),
        ("gain_d", "f4"),
        ("x", "f8"),  # state after the update
        ("v", "f8"),
        ("d", "f4"),
        ("bristle", "f8"),
        ("load_x", "f8"),
        ("load_v", "f8"),
        ("contact", "f4"),
        ("next_v", "f8"),  # predicted at the next tick
        ("x_v", "f4"),  # d (x at the next tick) / d v, and so on
        ("v_v", "f4"),
        ("x_d", "f4"),
        ("v_d", "f4"),
        ("d_d", "f4"),
        ("x_force", "f4"),  # d (x at the next tick) / d (torque during the tick)
        ("v_force", "f4"),
        ("xx", "f8"),  # covariance of the prediction that the update starts from
        ("xv", "f8"),
        ("xd", "f8"),
        ("vv", "f8"),
        ("vd", "f8"),
        ("dd", "f8"),
    ],
    align=True,
)
"""Results of the filter for one sample; single precision where no small differences are taken."""

NOISE = ("white", "sensor", "disturbance", "memory", "jitter")
"""Noise parameters: σ [N m √s], r [rad or m], s [N m], τ [s], time jitter of the samples [s]."""
WHITE, SENSOR, DISTURBANCE, CORRELATION, JITTER = range(5)
