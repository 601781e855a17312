"""Commands that never arrived: in a lost tick the current of the tick before stays.

Which ticks were lost is not recorded. Each loss kicks the shaft for one tick, so a window's residual votes for or against
every tick; a loss is accepted where it lowers the loss of the window by more than its prior costs, 2·log((1 − p)/p), and
that price stays in the window's loss. The result is an upper bound on the marginal loss over all sets of losses: the
freedom to choose them cannot buy evidence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.hypothesis import Term
from hapticd.plant.effects.layout import word

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]

_ROUNDS = 4
_CLEAR = 30.0
"""Loss that a lost command would cause, if it can be told at all whether it was lost."""


def _lost_in_windows(residual: Floats, kicks: Floats, weight: Floats, price: float, most: int) -> NDArray[np.bool_]:
    """Greedy choice of lost ticks (w, L) in every window.

    Args:
        residual: scaled residuals (w, L), initial state projected out.
        kicks: (w, L, L): response, so projected, to the loss of each tick (last axis).
        weight: robust weight (w,).
        price: cost of one loss.
        most: losses in one window at the most.
    """
    rest = residual.copy()
    lost = np.zeros(residual.shape, dtype=bool)
    power = np.einsum("wlj,wlj->wj", kicks, kicks)
    rows = np.arange(len(rest))
    for _ in range(most):
        gain = weight[:, None] * (2.0 * np.einsum("wlj,wl->wj", kicks, rest) - power)
        gain[lost] = -np.inf
        best = np.argmax(gain, axis=1)
        take = gain[rows, best] > price
        if not take.any():
            break
        lost[rows[take], best[take]] = True
        rest[take] -= kicks[rows[take], :, best[take]]
    return lost


def dropped_samples(context: Context) -> list[Term]:
    """Lost commands, found window by window, and the probability p that follows from them."""
    probability = 0.01
    masks: list[NDArray[np.bool_]] = []
    votes = context.kicks()
    if not votes:
        return []
    for _ in range(_ROUNDS):
        price = 2.0 * float(np.log((1.0 - probability) / probability))
        masks, found, visible = [], 0.0, 0.0
        for residual, kicks, weight in votes:
            lost = _lost_in_windows(residual, kicks, weight, max(price, 0.0), kicks.shape[1] // 2)
            clear = weight[:, None] * np.einsum("wlj,wlj->wj", kicks, kicks) > _CLEAR
            masks.append(lost)
            found += float((lost & clear).sum())
            visible += float(clear.sum())
        probability = float(np.clip((found + 0.5) / (visible + 1.0), 1e-4, 0.9))
        if found == 0.0:
            return []
    index = word("dropped_samples.p")
    lost_ticks = tuple(context.as_ticks(masks))
    spread = float(np.sqrt(probability * (1.0 - probability) / (visible + 1.0)))

    def write(vector: Floats, u: Floats) -> None:
        vector[index] = probability

    def parameters(u: Floats) -> dict[str, float]:
        return {"p": probability}

    return [Term("dropped_samples", (), write, parameters, (), lost=lost_ticks, form={"p_standard_error": spread})]
