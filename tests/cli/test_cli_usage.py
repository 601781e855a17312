"""The command line itself: wrong words, help, start-up cost, interrupts and broken pipes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from docs.make_pages import command_line
from hapticd.cli import exits
from hapticd.cli.main import build_app
from hapticd.cli.man import commands

from .conftest import Run

HEAVY = (
    "numba",
    "llvmlite",
    "numpy",
    "scipy",
    "pyarrow",
    "fastapi",
    "uvicorn",
    "httpx",
    "yaml",
    "matplotlib",
)
COMMANDS = dict(commands(typer.main.get_command(build_app()), "hapticd"))
LEAVES = {path: command for path, command in COMMANDS.items() if not hasattr(command, "commands")}


def python(code: str, *, check: bool = True) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], check=check, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["simulate", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    code = (
        f"import sys; from hapticd.cli.main import main; assert main({words}) == 0; "
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    assert python(code).stderr.strip() == "[]"


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_and_every_option_has_help(path: str) -> None:
    command = COMMANDS[path]
    assert command.help
    assert "Exit codes:" in command.epilog
    assert "Examples:" in command.epilog
    for parameter in command.params:
        assert parameter.help, f"{path} {parameter.name}"


@pytest.mark.parametrize("path", LEAVES)
def test_every_command_can_be_quiet(path: str) -> None:
    assert [parameter.opts for parameter in LEAVES[path].params if parameter.name == "quiet"] == [["--quiet", "-q"]]


@pytest.mark.parametrize("path", LEAVES)
def test_help_pages_show_examples_exit_codes_and_options(hapticd: Run, path: str) -> None:
    outcome = hapticd(*path.split()[1:], "--help")
    assert outcome.code == 0
    assert f"{path}" in outcome.out
    assert "Examples:" in outcome.out
    assert f"0  {exits.MEANING[exits.DONE]}" in outcome.out


@pytest.mark.parametrize("path", sorted(set(LEAVES) - {"hapticd run"}))
def test_every_command_that_reports_takes_json(path: str) -> None:
    assert any("--json" in parameter.opts for parameter in LEAVES[path].params)


def test_reference_page_is_current() -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "cli.md"
    assert page.read_text(encoding="utf-8") == command_line(), "run: python -m docs.make_pages"


def test_version(hapticd: Run) -> None:
    outcome = hapticd("--version")
    assert outcome.code == 0
    assert outcome.out.startswith("hapticd 0.")


def test_no_words_at_all_show_the_help_and_exit_2(hapticd: Run) -> None:
    outcome = hapticd()
    assert outcome.code == 2
    assert "simulate" in outcome.out + outcome.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("relase",), None),
        (("status", "--jsn"), None),
        (("release",), "Missing option '--deflection'. (see 'hapticd release --help')"),
        (
            ("release", "--deflection", "nan"),
            "Invalid value for '--deflection': 'nan' is not a finite number (see 'hapticd release --help')",
        ),
        (
            ("release", "--deflection", "far"),
            "Invalid value for '--deflection': 'far' is not a number (see 'hapticd release --help')",
        ),
        (
            ("release", "--deflection", "1", "--duration", "0"),
            "Invalid value for '--duration': '0' is not above zero (see 'hapticd release --help')",
        ),
        (("set",), "Missing argument 'KEY=VALUE'. (see 'hapticd set --help')"),
        (("set", "servo.rate_hz"), "'servo.rate_hz' is not KEY=VALUE (example: servo.rate_hz=500)"),
        (("set", "=500"), "'=500' is not KEY=VALUE (example: servo.rate_hz=500)"),
        (("set", "a=1", "a=2"), "a is given twice"),
        (("export", "x.arrow", "--to", "xls"), None),
        (("record", "pause"), "No such command 'pause'. (see 'hapticd record --help')"),
        (
            ("simulate", "--duration", "-1"),
            "Invalid value for '--duration': '-1' is not above zero (see 'hapticd simulate --help')",
        ),
    ],
)
def test_wrong_words_exit_2_with_an_exact_message(hapticd: Run, words: tuple[str, ...], message: str | None) -> None:
    outcome = hapticd(*words)
    assert (outcome.code, outcome.out) == (2, "")
    assert message is None or outcome.err == f"hapticd: {message}\n"
    document = hapticd(*words, "--json").document
    assert document["error"]["code"] == "usage"


def test_unforeseen_error_is_a_document_too(hapticd: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise RuntimeError("unforeseen")

    monkeypatch.setattr("hapticd.cli.status.connect", fail)
    outcome = hapticd("status", "--json")
    assert outcome.code == 1
    assert outcome.document["error"] == {
        "code": "internal",
        "message": "this is a bug in hapticd: RuntimeError: unforeseen",
    }
    assert "Traceback" in outcome.err


def test_reader_that_goes_away_is_no_error() -> None:
    reading, writing = os.pipe()
    command = [sys.executable, "-m", "hapticd.cli", "config", "schema"]
    with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
        os.close(reading)
        os.close(writing)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (exits.BROKEN_PIPE, "")


def test_ctrl_c_ends_quietly() -> None:
    code = (
        "import os, signal, sys; from hapticd.cli import status; from hapticd.cli.main import main; "
        "status.connect = lambda socket: os.kill(os.getpid(), signal.SIGINT); sys.exit(main(['status', '--json']))"
    )
    ended = python(code, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + signal.SIGINT, "", "hapticd: interrupted\n")


def test_linear_algebra_has_one_thread_from_the_start() -> None:
    """Decided before numpy is loaded; what somebody else has decided stays."""
    program = "import os, sys, hapticd.cli; print('numpy' in sys.modules, os.environ['OPENBLAS_NUM_THREADS'])"
    for given, expected in (({}, "False 1"), ({"OPENBLAS_NUM_THREADS": "2"}, "False 2")):
        environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"} | given
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == expected
