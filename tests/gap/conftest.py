"""Recordings with hidden effects for the tests of the gap workflow, from the benchmark's independent simulation."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.gap import devices
from benchmarks.gap.generate import STEP_S, generate
from hapticd.config import Config, parse_config
from hapticd.gap.recording import Recording

from .synthetic import run

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.gap.disturbance import Coloured

Case = tuple[Recording, Config]


@functools.lru_cache(maxsize=8)
def _made(
    effects: str, seed: int, duration_s: float, coloured: Coloured | None, device: str = "re35"
) -> tuple[Recording, Config, Any]:
    made = generate(json.loads(effects), seed, duration_s, device, coloured=coloured, step_s=4.0 * STEP_S)
    step = devices.resolution(made.nominal)
    recording = Recording(
        name="hidden",
        time_s=made.time_s - made.time_s[0],
        position=(made.counts + 0.5) * step,
        resolution=step,
        current=made.current_command,
        current_measured=None,
        period_s=float(np.median(np.diff(made.time_s))),
        is_linear=False,
    )
    return recording, parse_config(made.nominal, "nominal"), made


@pytest.fixture(scope="session")
def hidden() -> Callable[..., Case]:
    """hidden(effects, seed, duration_s, coloured, device): a recording with these effects, and the nominal model.

    The device is one of the benchmark's that turns, by default the testbed.
    """

    def make(
        effects: list[dict[str, Any]],
        seed: int = 1,
        duration_s: float = 8.0,
        coloured: Coloured | None = None,
        device: str = "re35",
    ) -> Case:
        return _made(json.dumps(effects), seed, duration_s, coloured, device)[:2]

    return make


@pytest.fixture(scope="session")
def truth() -> Callable[..., Any]:
    """truth(effects, seed, duration_s, coloured): what `benchmarks.gap.generate` knows of the recording of `hidden`."""

    def make(
        effects: list[dict[str, Any]], seed: int = 1, duration_s: float = 8.0, coloured: Coloured | None = None
    ) -> Any:
        return _made(json.dumps(effects), seed, duration_s, coloured)[2]

    return make


@pytest.fixture(scope="session")
def nominal_run() -> Recording:
    """A run of exactly the nominal device."""
    return run()
