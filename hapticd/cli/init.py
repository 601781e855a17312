"""``hapticd init``: a config from the few things that no measurement tells, asked or from a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.figures.files import refuse_existing, write_text

OutArgument = Annotated[Path, typer.Argument(metavar="CONFIG", help="The file to write.")]


@command(
    "hapticd init rig.yaml",
    "hapticd init rig.yaml --answers answers.yaml",
    "hapticd init --list",
)
def init(
    out: OutArgument = Path("rig.yaml"),
    answers: Path | None = None,
    list_questions: bool = False,
    force: bool = False,
) -> None:
    """Make a config for a rig: ask what the data sheets say, and write a file that checks.

    Motor, amplifier, encoder, driver and limits come from data sheets and from you. Inertia and friction are a start that
    'hapticd identify' replaces. Enter takes what is in brackets. Values may carry a unit: '62.8 g cm^2', '30 mN m/A', '500
    lines' (an encoder's lines count four times). Numbers that no such device has are questioned.

    Without a terminal and without --answers nothing is asked and the command ends with an error.

    Args:
        answers (FILE): YAML with the answers, key: value with the keys that --list shows; what is left out keeps its
            default.
        list_questions (--list): List the questions with keys, units and defaults, and stop.
        force: Replace an existing file.
    """
    from hapticd.identify.questions import QUESTIONS, answered, config_text, read_answers

    if list_questions:
        document: dict[str, Any] = {"questions": [question.document for question in QUESTIONS]}
        output.emit(document, "\n".join(question.line for question in QUESTIONS))
        return
    refuse_existing(out, force=force, source=answers)
    if answers is not None:
        given = read_answers(answers)
    elif sys.stdin.isatty():
        given = _ask()
    else:
        raise UsageError("nobody to ask: give --answers FILE (keys: hapticd init --list), or run it in a terminal")
    values = answered(given, str(answers or "answers"))
    text, config, warnings = config_text(values, given)
    write_text(out, text)
    document = {
        "config": out,
        "answers": values,
        "warnings": warnings,
        "linear": config.is_linear,
        "count_speed": config.count_speed,
    }
    limit, unit = config.safety.max_velocity, "m/s" if config.is_linear else "rad/s"
    said = [
        f"written: {out}",
        f"one count of the encoder in a period: {config.count_speed:.3g} {unit}"
        + (f" (safety.max_velocity = {limit:g} {unit})" if limit else ""),
        f"next: hapticd check {out}; then hapticd run {out}, and hapticd identify --live --model {out} -o {out}",
    ]
    output.emit(document, "\n".join(said))
    for warning in warnings:
        output.warn(f"warning: {warning}")


def _ask() -> dict[str, Any]:
    """Ask every question that the answers so far leave open; a wrong answer is asked again."""
    from hapticd.config import ConfigError
    from hapticd.identify.questions import QUESTIONS, answered, doubt_about

    given: dict[str, Any] = {}
    for question in QUESTIONS:
        if not question.applies(answered(given, "answers")):
            continue
        while True:
            said = typer.prompt(question.prompt, default=question.shown_default, err=True).strip()
            if said == question.shown_default:
                break
            try:
                value = answered({**given, question.key: said}, "answers")[question.key]
            except ConfigError as error:
                output.warn(str(error))
                continue
            doubt = doubt_about(question, value)
            if doubt and not typer.confirm(f"{doubt}. Keep it?", default=False, err=True):
                continue
            given[question.key] = said
            break
    return given
