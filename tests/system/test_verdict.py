"""How the system test judges what the guest sent, and what it says where it cannot run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import run  # noqa: E402

END = {"name": "end", "ok": True, "detail": "", "seconds": 0}


def found(name: str, ok: bool = True) -> dict[str, object]:
    return {"name": name, "ok": ok, "detail": "found", "seconds": 1.5}


@pytest.mark.parametrize(
    ("results", "failed"),
    [
        ([found("kernel"), END], False),
        ([found("kernel"), found("install_page", ok=False), END], True),
        ([found("kernel")], True),
        ([], True),
        ([END], True),
    ],
    ids=["passed", "a check failed", "did not get to the end", "did not boot", "checked nothing"],
)
def test_verdict(results: list[dict[str, object]], failed: bool, tmp_path: Path) -> None:
    console = tmp_path / "console.log"
    console.write_text("Kernel panic\n")
    assert run.report(results, console) is failed


def test_the_console_is_shown_where_the_guest_did_not_get_to_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    console = tmp_path / "console.log"
    console.write_text("Kernel panic\n")
    run.report([found("kernel")], console)
    assert "Kernel panic" in capsys.readouterr().out


def test_a_line_cut_off_and_the_serial_ports_noise_are_no_results(tmp_path: Path) -> None:
    results = tmp_path / "results.jsonl"
    results.write_text(f'\x00noise\n{json.dumps(found("kernel"))}\n{{"name": "install_page", "ok')
    assert run.read(results) == [found("kernel")]


@pytest.mark.parametrize(("words", "code"), [([], 2), (["--if-possible"], 0)])
def test_one_line_where_a_program_is_missing(words: list[str], code: int, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, HERE / "run.py", *words],
        env={"PATH": str(tmp_path)},
        stdout=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == code
    (line,) = done.stdout.splitlines()
    assert line.startswith("system test: not run: it needs ")
