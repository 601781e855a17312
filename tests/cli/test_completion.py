"""What a shell offers after `hapticd check`, `hapticd set spring.` and `hapticd excite`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer

from hapticd.cli.main import build_app


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a config and a folder in it."""
    monkeypatch.chdir(tmp_path)
    Path("rig.yaml").write_text("{}")
    Path("runs").mkdir()


def offered(name: str, parameter: str, incomplete: str) -> list[str]:
    """What a command's parameter completes a word to."""
    group: Any = typer.main.get_command(build_app())
    command = group.commands[name]
    (found,) = (each for each in command.params if each.name == parameter)
    return [item.value for item in found.shell_complete(typer.Context(command), incomplete)]


def test_configs() -> None:
    assert {"re35", "omega", "rig.yaml", "runs/"} <= set(offered("check", "source", ""))
    assert offered("check", "source", "ri") == ["rig.yaml"]
    assert offered("check", "source", "nowhere/") == []


def test_settings() -> None:
    assert {"spring.stiffness=", "spring.damping="} <= set(offered("set", "assignments", "spring."))
    assert offered("check", "assignments", "encoder.dec") == ["encoder.decimation="]


def test_experiments() -> None:
    assert {"all", "chirp", "rig.yaml"} <= set(offered("excite", "name", ""))
    assert offered("excite", "name", "chi") == ["chirp"]
