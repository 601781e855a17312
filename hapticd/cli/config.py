"""``hapticd config schema`` and ``config show``."""

from __future__ import annotations

from typing import Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import ConfigArgument, JsonOption, SettingsOption, epilog, register, resolve_config

SchemaJsonOption = Annotated[
    bool, typer.Option("--json", help="Accepted for uniformity; a JSON Schema is JSON anyway.")
]


def schema(as_json: SchemaJsonOption = False) -> int:
    """Print the JSON Schema of the config: every key with its meaning, unit, limits and default.

    Editors use it to complete and check a config file.
    """
    from hapticd.config import config_schema

    print(output.to_json(config_schema()))
    return exits.DONE


def show(config: ConfigArgument = None, assignments: SettingsOption = None, as_json: JsonOption = False) -> int:
    """Print the resolved config, every default filled in, as YAML or JSON (SI units).

    The output is itself a valid config file.
    """
    resolved = resolve_config(config, assignments)
    from hapticd.config import config_to_yaml

    output.emit(resolved.model_dump(mode="json"), as_json, config_to_yaml(resolved).rstrip("\n"))
    return exits.DONE


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    codes = (exits.DONE, exits.USAGE)
    group = typer.Typer(help="Look at the config.", no_args_is_help=True, rich_markup_mode="rich")
    register(group, schema, "hapticd config schema > hapticd.schema.json", codes=codes)
    examples = ("hapticd config show > rig.yaml", "hapticd config show phantom --set servo.rate_hz=500 --json")
    register(group, show, *examples, codes=codes)
    app.add_typer(group, name="config", epilog=epilog("hapticd config show", codes=codes))
