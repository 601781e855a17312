"""The core itself: a million frames under sanitizers, mutants that they find, coverage, size and stack."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.firmware.builds import SOURCE, build, require

CORPUS = sorted((SOURCE / "fuzz" / "corpus").iterdir())


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, timeout=250)


@pytest.fixture(scope="module")
def frames() -> Path:
    assert build("host") is None
    made = run("make", "-C", SOURCE, "frames")
    assert made.returncode == 0, made.stderr
    return SOURCE / "build" / "fuzz" / "frames"


def test_a_million_random_and_mutated_frames(frames: Path) -> None:
    done = run(frames, "1000000", "20261122")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1000000 frames, ")
    assert int(done.stdout.split()[2]) > 100_000  # replies: they get through


def test_what_the_fuzzer_kept(frames: Path) -> None:
    assert len(CORPUS) > 20
    done = run(frames, *CORPUS)
    assert done.returncode == 0, done.stderr


MUTANTS = {
    "the watchdog is not restarted": ("        board_watchdog_start(watchdog_ms);\n", ""),
    "a fault does not switch off": (
        "        disable_output();\n        set_status(causes);",
        "        set_status(causes);",
    ),
    "the output is not at mid-scale when off": (
        "    board_dac_write(middle());\n    board_watchdog_stop",
        "    board_watchdog_stop",
    ),
    "enabled with a fault latched": (
        "(status & (LATCHED | CORE_UNCONFIGURED)) != 0U",
        "(status & CORE_UNCONFIGURED) != 0U",
    ),
    "a code of too many bits": ("(code > last) || ", ""),
    "interrupts stay off": ("    board_interrupts_restore(before);\n}\n\n/* Act", "}\n\n/* Act"),
    "the CRC is not looked at": (
        "if (decoder->crc != (uint16_t)(decoder->data[length] | high))",
        "if (decoder->crc == 0x12345U)",
    ),
    "a frame too long is taken": ("decoder->received >= FRAMING_LONGEST_FRAME", "decoder->received >= 250U"),
    "the queue overflows": ("(uint8_t)(QUEUE_BYTES - 1U - used) < size", "false"),
    "switched on with the enable released": (" || (((flags & FLAG_WHILE_HELD) != 0U) && released)", ""),
    "the enable is not looked at": ("        released = true;\n        if (while_held", "        if (while_held"),
    "the watchdog does nothing": (
        "        disable_output();\n        set_status(CORE_WATCHDOG);",
        "        set_status(CORE_WATCHDOG);",
    ),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_broken_core_is_found(frames: Path, tmp_path: Path, name: str) -> None:
    old, new = MUTANTS[name]
    for part in ("core", "fuzz"):
        shutil.copytree(SOURCE / part, tmp_path / part)
    sources = [path for path in (tmp_path / "core").glob("*.c") if old in path.read_text()]
    assert len(sources) == 1
    sources[0].write_text(sources[0].read_text().replace(old, new))
    files = [tmp_path / name for name in ("core/core.c", "core/framing.c", "fuzz/harness.c", "fuzz/random.c")]
    include = ["-I", tmp_path / "core", "-I", tmp_path / "fuzz"]
    flags = ["-std=c11", "-O1", "-w", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    made = run("gcc", *flags, *include, "-o", tmp_path / "mutant", *files)
    assert made.returncode == 0, made.stderr
    assert run(tmp_path / "mutant", "200000", "1").returncode != 0


def test_coverage(frames: Path) -> None:
    done = run("make", "-C", SOURCE, "coverage")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "core/core.c" in done.stdout
    assert "core/framing.c" in done.stdout


def test_recursion_has_no_stack_depth() -> None:
    spec = importlib.util.spec_from_file_location("report", SOURCE / "report.py")
    assert spec is not None
    assert spec.loader is not None
    report = importlib.util.module_from_spec(spec)
    sys.modules["report"] = report
    spec.loader.exec_module(report)
    graph = {"main": {"a", "b"}, "a": {"b"}, "b": set()}
    assert report.deepest("main", {"main": 8, "a": 16, "b": 4}, graph, 0, ()) == 28
    with pytest.raises(SystemExit, match="recursion: main → a → main"):
        report.deepest("main", {}, {"main": {"a"}, "a": {"main"}}, 0, ())


def test_size_and_stack() -> None:
    require("mps2-an385")
    done = run(sys.executable, SOURCE / "report.py", "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["board"]: row for row in json.loads(done.stdout)}
    assert 1000 < rows["mps2-an385"]["flash"] < 4096
    assert 100 < rows["mps2-an385"]["stack"] < 600
