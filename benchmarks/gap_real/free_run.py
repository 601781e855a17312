"""How far a model strays when it is given nothing but the recorded commands: the hardest test that a record allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config
from hapticd.gap.recording import Recording
from hapticd.plant import Plant


def positions(model: Config, recording: Recording) -> NDArray[np.float64]:
    """Open-loop positions at the recorded instants, shape (n,), from the first position at rest."""
    plant = Plant.from_config(model, position=float(recording.position[0]))
    found = np.empty(recording.rows)
    for k, (time, current) in enumerate(zip(recording.time_s, recording.current, strict=True)):
        plant.advance(float(time))
        found[k] = plant.position
        plant.command(float(current), float(time))
    return found


def rmse(model: Config, recording: Recording) -> float:
    """Root mean square of what separates the model's free run from the record, rad or m."""
    return float(np.sqrt(np.mean((positions(model, recording) - recording.position) ** 2)))
