"""What the documentation tells a reader to type: every hapticd command exists, configs are valid, marked blocks are run."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
import yaml

from hapticd.cli.main import build_app
from hapticd.cli.man import commands
from hapticd.client import Client
from hapticd.config import parse_config
from hapticd.config.model import Config

from .snippets import GENERATED, PAGES, ROOT, Snippet, hapticd_commands, snippets

SHELL = ("sh", "console", "bash", "")
PROGRAM = dict(commands(typer.main.get_command(build_app()), "hapticd"))
BLOCKS = [snippet for page in PAGES if page not in GENERATED for snippet in snippets(page)]
COMMANDS = [
    pytest.param(words, id=f"{block}-{k}")
    for block in BLOCKS
    if block.language in SHELL
    for k, words in enumerate(hapticd_commands(block))
]


def is_config(block: Snippet) -> bool:
    """A block with a section of the config in it.

    A script of the simulated hardware has a ``hand`` too, and faults; an import map has an ``encoder``, and a device.
    """
    if block.language != "yaml":
        return False
    keys = set(yaml.safe_load(block.body) or {})
    return bool(keys & set(Config.model_fields)) and not keys & {"faults", "device"}


CONFIGS = [pytest.param(block, id=str(block)) for block in BLOCKS if is_config(block)]
RUNNING = {block.page for block in BLOCKS if block.pattern is not None}


def test_the_pages_hold_what_is_tested_here() -> None:
    assert len(COMMANDS) > 90
    assert len(CONFIGS) > 8
    assert len(RUNNING) >= 4


@pytest.mark.parametrize("words", COMMANDS)
def test_every_command_and_option_exists(words: list[str]) -> None:
    """Parsed down to the leaf as typed, and not run."""
    words = [word for word in words if word not in ("--help", "--version")]
    length = max(k for k in range(len(words) + 1) if " ".join(["hapticd", *words[:k]]) in PROGRAM)
    path = " ".join(["hapticd", *words[:length]])
    command = PROGRAM[path]
    if getattr(command, "commands", None):
        assert words[length:] == [], f"{path} has no command {words[length]}"
    else:
        command.make_context(path, words[length:])


@pytest.mark.parametrize("block", CONFIGS)
def test_configs_are_valid(block: Snippet) -> None:
    parse_config(yaml.safe_load(block.body), str(block))


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """A reader's terminal: hapticd on the path, a daemon on HAPTICD_SOCKET, files of its own."""
    path = [str(Path(sys.executable).parent), os.environ["PATH"]]
    places = {"XDG_STATE_HOME": tmp_path / "state", "XDG_RUNTIME_DIR": tmp_path, "HAPTICD_SOCKET": tmp_path / "h.sock"}
    return os.environ | {"PATH": ":".join(path), "PYTHONPATH": str(ROOT)} | {k: str(v) for k, v in places.items()}


@pytest.fixture
def daemon(environment: dict[str, str], tmp_path: Path) -> Iterator[None]:
    """The daemon on the loopback. A machine that is late is not what is tested."""
    command = ["hapticd", "run", "--set", "servo.overrun.fault_after=0", "--set", "safety.heartbeat_timeout_s=10"]
    with (
        (tmp_path / "daemon.log").open("wb") as log,
        subprocess.Popen(command, env=environment, stdout=log, stderr=log) as process,
    ):
        try:
            client = Client(environment["HAPTICD_SOCKET"])
            deadline = time.monotonic() + 200
            while not client.socket_path.exists():
                assert process.poll() is None, (tmp_path / "daemon.log").read_text()
                assert time.monotonic() < deadline
                time.sleep(0.1)
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)


@pytest.mark.parametrize("page", [pytest.param(page, id=page.stem) for page in sorted(RUNNING)])
@pytest.mark.usefixtures("daemon")
def test_blocks_marked_run_do_what_the_page_says(page: Path, environment: dict[str, str], tmp_path: Path) -> None:
    for block in snippets(page):
        if block.pattern is None:
            continue
        program = ["bash", "-euo", "pipefail"] if block.language == "sh" else [sys.executable]
        done = subprocess.run(
            [*program, "-c", block.body],
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, f"{block}: exit code {done.returncode}\n{done.stdout}"
        assert re.search(block.pattern, done.stdout), f"{block}: no {block.pattern!r} in\n{done.stdout}"
