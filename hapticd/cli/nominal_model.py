"""The nominal model of a command that compares it with recordings: ``--model``, or the config that goes with the data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hapticd.cli.exits import UsageError
from hapticd.cli.options import parse_settings, resolve_config

if TYPE_CHECKING:
    from hapticd.client import Client
    from hapticd.config import Config


def model_of_run(run: Path, model: str | None, assignments: list[str] | None) -> Config:
    """The model that is named, or the one that a recording carries.

    Raises:
        ConfigError: anything wrong in it.
        UsageError: the recording carries none, or ``--set`` without a model.
    """
    if model is not None:
        return resolve_config(model, assignments)
    if assignments:
        raise UsageError("--set changes the model of --model; name one")
    from hapticd.config import parse_config
    from hapticd.record import read_run

    stored = read_run(run).metadata.get("config")
    if not stored:
        raise UsageError(f"{run} carries no config; name the nominal model with --model")
    return parse_config(stored, f"config of {run.name}")


def model_of_daemon(client: Client, model: str | None, assignments: list[str] | None) -> Config:
    """The model that is named, or the daemon's config.

    Raises:
        ConfigError: anything wrong in it.
    """
    if model is not None:
        return resolve_config(model, assignments)
    from hapticd.config import apply_settings, parse_config

    nominal = parse_config(client.config(), "the daemon's config")
    return apply_settings(nominal, parse_settings(assignments)) if assignments else nominal
