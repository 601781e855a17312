"""Where the model as given and the recordings part, and what explains the same, by the balance of forces: for the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hapticd.gap.force import force_residual
from hapticd.gap.screen import screen
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


def confounded(recordings: Sequence[Recording], model: Config, effects: Sequence[str]) -> list[dict[str, Any]]:
    """What gap.json says under ``confounded``: effects that explain the same missing torque as those that were named.

    Args:
        recordings: what was measured. model: as given.
        effects: slugs that were named.

    Returns:
        ``first`` and ``second`` (the better one first), ``overlap``, ``advantage_z``, ``resolved`` and ``words`` each;
        nothing where the shaft hardly moves.
    """
    try:
        pairs = screen(recordings, model).confounded
    except ValueError:
        return []
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
        for pair in pairs
        if {pair.first, pair.second} & set(effects)
    ][:_TOLD]
