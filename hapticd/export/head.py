"""What is said at the head of an exported model: whose it is, and how the format says each effect."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

from drivers import declared_latency
from hapticd.config import config_digest
from hapticd.export.table import Format, sayings

if TYPE_CHECKING:
    from hapticd.config import Config


def remarks(config: Config, to: Format) -> list[str]:
    """Sentences, one a line."""
    units = "m, N, kg" if config.is_linear else "rad, N m, kg m^2"
    lines = [
        f"Written by hapticd {version('hapticd')} from config {config_digest(config)}: SI units ({units}, s, A).",
        *(
            f"{slug}: {said.how}{f', in {said.where}' if said.where else ''}{f': {said.why}' if said.why else ''}."
            for slug, said in sayings([effect.name for effect in config.plant.effects], to).items()
        ),
        *doubts(config),
    ]
    # Neither may end an XML comment or a docstring, whatever a driver is called.
    return [line.replace("--", "-").replace('"', "'").replace("\\", "/") for line in lines]


def doubts(config: Config) -> list[str]:
    """What is not known of the model."""
    _, doubt = declared_latency(config)
    return [f"{doubt}."] if doubt else []
