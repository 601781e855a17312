"""``hapticd config schema`` and ``config show``."""

from __future__ import annotations

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.options import ConfigArgument, SettingsOption, resolve_config


@command("hapticd config schema > hapticd.schema.json", json=False)
def schema(as_json: bool = False) -> None:
    """Print the JSON Schema of the config: every key with its meaning, unit, limits and default.

    Editors use it to complete and check a config file.

    Args:
        as_json (--json): Accepted for uniformity; a JSON Schema is JSON anyway.
    """
    from hapticd.config import config_schema

    print(output.to_json(config_schema()))


@command(
    "hapticd config show > rig.yaml",
    "hapticd config show phantom --set servo.rate_hz=500 --json",
)
def show(config: ConfigArgument = None, assignments: SettingsOption = None) -> None:
    """Print the resolved config, every default filled in, as YAML or JSON (SI units).

    The output is itself a valid config file.
    """
    resolved = resolve_config(config, assignments)
    from hapticd.config import config_to_yaml

    output.emit(resolved.model_dump(mode="json"), config_to_yaml(resolved).rstrip("\n"))
