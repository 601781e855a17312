"""Where the model as given and the recordings part, and what explains the same, by the balance of forces: for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hapticd.gap.force import force_residual
from hapticd.gap.screen import Screening, ScreenScore, screen
from hapticd.gap.where import coordinates_at, map_residual

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.data import Recording

_TOLD = 6


def disagreement(recordings: Sequence[Recording], model: Config, delay_s: float, seed: int) -> list[dict[str, Any]]:
    """What gap.json says under ``where``: significant places of the longest recording, those that explain most first.

    Args:
        recordings: what was measured. model: as given.
        delay_s: from the stamp of a command to its effect in that model.
        seed: of the shifts that give the level of chance.

    Returns:
        ``coordinate``, ``range``, ``share``, ``unit`` and ``words`` each; nothing where the shaft hardly moves.
    """
    longest = max(recordings, key=lambda recording: recording.rows)
    try:
        score = force_residual(longest, model, delay_s=delay_s)
        coordinates = coordinates_at(longest, score.signals.motion, score.time_s)
        places = map_residual(score.residual, coordinates, is_linear=longest.is_linear, seed=seed)
    except ValueError:
        return []
    return [place.to_json() for place in places if place.significant][:_TOLD]


def force_balance(recordings: Sequence[Recording], model: Config, refit_base: bool) -> Screening | None:
    """The catalogue by the balance of forces; None where the shaft hardly moves.

    Args:
        recordings: what was measured. model: as given.
        refit_base: base parameters are fitted along.
    """
    try:
        return screen(recordings, model, refit_base=refit_base)
    except ValueError:
        return None


def balance_json(screening: Screening, candidates: Sequence[str], is_linear: bool) -> dict[str, Any]:
    """What gap.json says under ``balance``.

    Args:
        screening: of the catalogue.
        candidates: slugs that were considered.
        is_linear: whether forces are missing, or torques.

    Returns:
        ``unit``, ``rms`` of the force or torque that the model lacks, ``ranking`` of the candidates that explain a
        significant part of it (``effect``, ``rms`` held out with it, ``share`` of the squared rms that goes away, ``z`` in
        standard errors, ``parameters``, ``identical_to``), and ``words`` on the first of them, empty where there is none.
    """
    unit = "N" if is_linear else "N m"
    found = [score for score in screening.ranking if score.significant and score.slug in set(candidates)][:_TOLD]
    words = ""
    if found:
        best = found[0]
        alike = "".join(f", or {slug}" for slug in best.identical_to)
        words = (
            f"by the balance of forces {best.slug}{_orders(best)}{alike} explains most, {100.0 * best.share:.0f} % of the "
            f"square: held out, {screening.cv_rms:.3g} {unit} are missing without it and {best.cv_rms:.3g} {unit} with it"
        )
    return {
        "unit": unit,
        "rms": screening.cv_rms,
        "ranking": [
            {
                "effect": score.slug,
                "rms": score.cv_rms,
                "share": score.share,
                "z": score.z,
                "parameters": {name: asdict(coefficient) for name, coefficient in score.coefficients.items()},
                "identical_to": list(score.identical_to),
            }
            for score in found
        ],
        "words": words,
    }


def _orders(score: ScreenScore) -> str:
    """The orders of a ripple in words, the largest amplitude first."""
    orders = [name.removeprefix("a_").removesuffix("_sin") for name in score.coefficients if name.endswith("_sin")]
    if score.slug != "torque_ripple" or not orders:
        return ""
    size = {
        order: sum(score.coefficients[f"a_{order}_{part}"].value ** 2 for part in ("sin", "cos")) for order in orders
    }
    return f" (orders {', '.join(sorted(orders, key=lambda order: -size[order])[:_TOLD])})"


def confounded(screening: Screening, effects: Sequence[str]) -> list[dict[str, Any]]:
    """What gap.json says under ``confounded``: effects that explain the same missing torque as those that were named.

    Args:
        screening: of the catalogue.
        effects: slugs that were named.

    Returns:
        ``first`` and ``second`` (the better one first), ``overlap``, ``advantage_z``, ``resolved`` and ``words`` each.
    """
    return [
        {
            "first": pair.first,
            "second": pair.second,
            "overlap": pair.overlap,
            "advantage_z": pair.advantage_z,
            "resolved": pair.resolved,
            "words": (
                f"of what {pair.second} explains, {pair.first} explains {100.0 * min(pair.overlap, 1.0):.0f} % as well; "
                + (
                    f"{pair.second} is worse by {pair.advantage_z:.1f} standard errors"
                    if pair.resolved
                    else "the balance of forces leaves open which it is"
                )
            ),
        }
        for pair in screening.confounded
        if {pair.first, pair.second} & set(effects)
    ][:_TOLD]
