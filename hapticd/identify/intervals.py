"""Covariance of an estimate by deleting blocks of the data: the cluster jackknife.

A torque that no model has hangs together for a while, and so do the scores. Without block g the estimate would move, in one
step, by −(H − H_g)⁻¹ s_g, where s_g is the sum of the block's scores and H their outer product over all samples. With few
blocks this keeps its coverage where the sandwich H⁻¹ (Σ s_g s_gᵀ) H⁻¹ is too narrow, since a block that tells much of a
parameter pulls the estimate towards itself (CV3 of MacKinnon, Nielsen and Webb, J. Econometrics 232, 2023).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

BLOCKS = 10
"""Long ones hold several correlation times of a slow torque; fewer leave no degrees of freedom."""


def student_reach(blocks: int = BLOCKS) -> float:
    """Half-width of a 95 % interval in standard deviations, by Student's distribution over the blocks."""
    return float(student.isf(0.025, blocks - 1))


def jackknife(scores: Floats, block: NDArray[np.int64]) -> Floats:
    """Covariance of an estimate.

    Args:
        scores: (n, k) derivative of each sample's log probability by each parameter, at the estimate.
        block: (n,) number of each sample's block, from 0.

    Returns:
        Shape (k, k). Standard deviations are never smaller than independent samples would make them.
    """
    blocks = int(block.max()) + 1
    scale = np.sqrt(np.sum(scores**2, axis=0)) + 1e-300
    S = (scores - scores.mean(axis=0)) / scale
    H = S.T @ S
    ridge = 1e-9 * np.eye(scale.size)
    moves = []
    for number in range(blocks):
        own = S[block == number]
        moves.append(np.linalg.solve(H - own.T @ own + ridge, own.sum(axis=0)))
    found = (blocks - 1) / blocks * np.stack(moves).T @ np.stack(moves)
    least = np.diag(np.linalg.inv(H + ridge))
    wider = np.sqrt(np.maximum(least / np.maximum(np.diag(found), 1e-300), 1.0))
    return np.asarray(found * np.outer(wider, wider) / np.outer(scale, scale), dtype=np.float64)


def blocks_of(time_s: Floats, recording: NDArray[np.int64], blocks: int = BLOCKS) -> NDArray[np.int64]:
    """Number of the block of each sample: equal times, one recording after the other; shape (n,)."""
    steps = np.diff(time_s, prepend=time_s[:1])
    steps[np.diff(recording, prepend=recording[:1]) != 0] = 0.0
    passed = np.cumsum(steps)
    return np.minimum((passed / max(float(passed[-1]), 1e-300) * blocks).astype(np.int64), blocks - 1)
