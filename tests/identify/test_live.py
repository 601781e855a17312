"""`identify --live`: current grows until the shaft moves, chirps keep to the limits, the spring is off."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hapticd.client import Client
from hapticd.config import Config, parse_config
from hapticd.gap.balance import Balance
from hapticd.gap.live import LiveError
from hapticd.identify.live import chirp, record_live

INERTIA, COULOMB = 6e-6, 2e-3
CONFIG = parse_config({"safety": {"max_excursion": 2.0, "max_velocity": 50.0}}, "rig")
STIFFNESS = CONFIG.spring.stiffness
FIRST = Balance(INERTIA, 1e-5, COULOMB, 0.0, 1e-3, 1, 0.99, 1e-3, 0.1, np.zeros((1, 5)))


@dataclass
class FakeDaemon:
    """A shaft that moves from `break_away` A upwards; notes what it is asked."""

    break_away: float = 0.05
    fault: str | None = None
    calls: list[Any] = field(default_factory=list)
    amplitudes: list[float] = field(default_factory=list)

    def config(self) -> dict[str, Any]:
        return CONFIG.model_dump()

    def set(self, settings: dict[str, Any], force: bool = False) -> None:
        self.calls.append(settings)

    def excite(self, name: str, **plan: Any) -> dict[str, Any]:
        self.calls.append(name)
        self.amplitudes.append(plan["amplitude"])
        return {"experiment": 1}

    def wait(self, number: int, progress: Any) -> dict[str, Any]:
        moved = self.amplitudes[-1] >= self.break_away
        return {"state": "done", "result": {"run": f"/r/{'moved' if moved else 'still'}.arrow", "fault": self.fault}}


@contextmanager
def no_bar(label: str) -> Iterator[Any]:
    yield lambda share: None


@pytest.fixture(autouse=True)
def _runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(path: Path) -> Any:
        return SimpleNamespace(columns={"encoder_counts": np.arange(100 if path.stem == "moved" else 3)})

    monkeypatch.setattr("hapticd.identify.live.read_run", read)
    monkeypatch.setattr("hapticd.identify.live.load_any", lambda path, config: path.name)
    monkeypatch.setattr("hapticd.identify.live.balance", lambda recordings, constant: FIRST)


def recorded(daemon: FakeDaemon, *, keep_spring: bool = False) -> list[Any]:
    said: list[str] = []
    return list(record_live(cast(Client, daemon), CONFIG, said.append, no_bar, keep_spring=keep_spring))


def test_current_grows_until_the_shaft_moves_and_two_chirps_follow() -> None:
    daemon = FakeDaemon()
    assert recorded(daemon) == ["moved.arrow"] * 3
    search = daemon.amplitudes[:-3]
    assert search == sorted(search)
    assert search[-1] >= daemon.break_away > search[-2]
    assert daemon.amplitudes[-3] > search[-1]


def test_the_spring_is_off_for_every_experiment_and_back_afterwards() -> None:
    daemon = FakeDaemon()
    recorded(daemon)
    settings = [call for call in daemon.calls if isinstance(call, dict)]
    assert daemon.calls[0] == {"spring.stiffness": 0.0}
    assert daemon.calls[-1] == {"spring.stiffness": STIFFNESS}
    assert [next(iter(each.values())) for each in settings] == [0.0, STIFFNESS] * len(daemon.amplitudes)


def test_the_spring_may_stay() -> None:
    daemon = FakeDaemon()
    recorded(daemon, keep_spring=True)
    assert set(daemon.calls) == {"chirp"}


def test_a_shaft_that_never_moves_is_said_and_the_current_stays_below_the_continuous_one() -> None:
    daemon = FakeDaemon(break_away=1e3)
    with pytest.raises(LiveError, match="the shaft moves less than 40 counts up to"):
        recorded(daemon)
    assert CONFIG.amplifier.continuous_current is not None
    assert max(daemon.amplitudes) <= 0.8 * CONFIG.amplifier.continuous_current


def test_an_experiment_that_ends_on_a_fault_is_no_data() -> None:
    daemon = FakeDaemon(fault="over_speed")
    with pytest.raises(LiveError, match="chirp ended early on the fault over_speed"):
        recorded(daemon)
    assert len(daemon.amplitudes) == 1


@pytest.mark.parametrize("effort", [2.0, 4.0])
def test_a_chirp_keeps_to_a_part_of_travel_and_speed(effort: float) -> None:
    """By the motion of an inertia under the torque beyond friction, to and fro at the lowest frequency."""
    plan = chirp(CONFIG, FIRST, effort)
    assert plan.low_hz is not None
    omega = 2.0 * np.pi * plan.low_hz
    acceleration = (plan.amplitude * CONFIG.amplifier.torque_constant - COULOMB) / INERTIA
    assert acceleration / omega**2 <= 0.2 * 2.0 * 1.02
    assert acceleration / omega <= 0.3 * 50.0 * 1.02


def test_a_rig_without_limits_gets_a_chirp_too() -> None:
    free: Config = parse_config({"safety": {"max_excursion": 0, "max_velocity": 0}}, "free")
    plan = chirp(free, FIRST, 2.0)
    assert plan.low_hz is not None
    assert plan.high_hz is not None
    assert 0.5 <= plan.low_hz < plan.high_hz <= free.servo.rate_hz / 10.0
