"""Effect of the improved model on the loop: operating point, region, largest stiffness, limit cycle, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from hapticd.stability.assessment import assess
from hapticd.stability.explore import GUARD

if TYPE_CHECKING:
    from hapticd.config import Config

_DEFLECTION_TICKS: Final = 20.0
"""Deflection of the release for which both models are checked [coarse ticks]."""


def consequences(before: Config, after: Config, latency_s: float = 0.0) -> dict[str, Any]:
    """Results of ``hapticd check`` for both models.

    Args:
        before: the given model. after: the improved one.
        latency_s: the driver's declared latency.

    Returns:
        ``before`` and ``after``: the keys of ``check``; ``words``: the changes, one sentence each.
    """
    documents = [
        assess(model, deflection=_DEFLECTION_TICKS, latency_s=latency_s, effort=GUARD).document
        for model in (before, after)
    ]
    return {"before": documents[0], "after": documents[1], "words": _text(*documents)}


def _text(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    sentences = []
    numbers = (("mu", "μ"), ("beta", "β"), ("sigma", "σ"), ("tau_d", "τ_D"))
    moved = [
        f"{symbol} from {before[key]:.4g} to {after[key]:.4g}"
        for key, symbol in numbers
        if abs(after[key] - before[key]) > 1e-3 * max(abs(before[key]), 1e-9)
    ]
    sentences.append(f"The operating point moves: {', '.join(moved)}." if moved else "The operating point stays.")
    if after["region"] != before["region"]:
        sentences.append(f"Region {before['region']} becomes {after['region']}: {after['meaning']}.")
    else:
        sentences.append(f"It stays in region {before['region']}: {before['meaning']}.")
    K = [document["stiffness_max"]["dissipating"] for document in (before, after)]
    if K[0] is not None and K[1] is not None and abs(K[1] - K[0]) > 1e-3 * abs(K[0]):
        sentences.append(f"The largest stiffness that dissipates goes from {K[0]:.4g} to {K[1]:.4g}.")
    cycles = [document["limit_cycle"] for document in (before, after)]
    if cycles[0]["predicted"] != cycles[1]["predicted"]:
        sentences.append(
            "A limit cycle is now predicted." if cycles[1]["predicted"] else "No limit cycle is predicted any more."
        )
    return sentences
