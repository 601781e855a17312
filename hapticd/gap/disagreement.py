"""Where the model as given and the recordings part, for the report: the missing torque laid over every coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hapticd.gap.force import force_residual
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
