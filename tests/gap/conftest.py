"""Recordings with hidden effects for the tests of the gap workflow, from the benchmark's independent simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.gap import devices
from benchmarks.gap.generate import generate
from hapticd.config import Config, parse_config
from hapticd.gap.data import Recording

from .synthetic import run

if TYPE_CHECKING:
    from collections.abc import Callable

Case = tuple[Recording, Config]


@pytest.fixture(scope="session")
def hidden() -> Callable[..., Case]:
    """hidden(effects, seed, duration_s): a recording of the testbed with these effects, and its nominal model."""

    def make(effects: list[dict[str, Any]], seed: int = 1, duration_s: float = 8.0) -> Case:
        made = generate(effects, seed, duration_s, "re35")
        step = devices.resolution(made.nominal)
        recording = Recording(
            name="hidden",
            time_s=made.time_s - made.time_s[0],
            position=(made.counts + 0.5) * step,
            resolution=step,
            current=made.current_command,
            current_measured=None,
            period_s=float(np.median(np.diff(made.time_s))),
            lateness_s=made.lateness_s,
            is_linear=False,
            config=None,
        )
        return recording, parse_config(made.nominal, "nominal")

    return make


@pytest.fixture(scope="session")
def nominal_run() -> Recording:
    """A run of exactly the nominal device."""
    return run()
