"""The lines that ``hapticd run`` begins with."""

from __future__ import annotations

from pathlib import Path

import pytest

from hapticd.service.foreground import banner
from tests.service.daemons import SOCKET, daemon_on, state_home

__all__ = ["state_home"]


@pytest.mark.parametrize(("stiffness", "numbers"), [(0.012, "μ 523.3  β 0.75 "), (0.0, "μ ∞  β ∞  σ ∞ ")])
def test_operating_point_with_a_spring_and_without(
    stiffness: float, numbers: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, spring={"stiffness": stiffness}) as (daemon, _devices):
        (line,) = (line for line in banner(daemon, SOCKET, "rig.yaml") if line.startswith("operating"))
    assert numbers in line
