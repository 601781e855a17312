from __future__ import annotations

import json
import shlex
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.record import read_run

CHILD = [sys.executable, str(Path(__file__).with_name("crash_child.py"))]
IN_SMALL_DISK = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]


def check_full(report: dict[str, Any], cause: str) -> None:
    failed = report["failed"]
    assert failed["state"] == "failed"
    assert failed["error"] == (
        f"recording stopped: the disk is full ({cause}); {report['rows']} rows are kept in {report['path']}"
    )
    assert failed["rows"] == report["rows"] > 0
    assert report["stopped"] == report["path"]
    assert report["truncated"]
    assert report["ticks_whole"]
    assert report["made"] > report["rows"]
    assert report["left"] == 0, "the ring is emptied after the failure, too"
    assert report["dump"].startswith(f"recording stopped: the disk is full ({cause}); ")
    assert report["again"] == 5


@pytest.mark.parametrize("delay", [0.0, 0.037, 0.33])
def test_sigkill_leaves_a_file_that_reads_to_half_a_second_before(tmp_path: Path, delay: float) -> None:
    clock = tmp_path / "clock"
    clock.write_bytes(bytes(8))
    with subprocess.Popen([*CHILD, "until_killed", str(tmp_path), str(clock)], stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        path = Path(child.stdout.readline().decode().strip())
        time.sleep(delay)
        child.send_signal(signal.SIGKILL)
        assert child.wait() == -signal.SIGKILL
    (newest,) = struct.unpack("d", clock.read_bytes())
    run = read_run(path)
    assert run.truncated
    assert np.array_equal(run.columns["tick"], np.arange(run.rows))
    assert newest - run.columns["time_s"][-1] <= 0.5


def test_a_file_size_limit_stops_the_recording_and_nothing_else(tmp_path: Path) -> None:
    command = [*CHILD, "until_full", str(tmp_path), "500000"]
    report = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=60).stdout)
    check_full(report, "File too large")


def test_a_full_disk_stops_the_recording_and_nothing_else(tmp_path: Path) -> None:
    mount = f"mount -t tmpfs -o size=512k small {shlex.quote(str(tmp_path))}"
    if subprocess.run([*IN_SMALL_DISK, mount], capture_output=True, check=False).returncode:
        pytest.skip("no unprivileged mount namespace here")
    command = f"{mount} && exec {shlex.join([*CHILD, 'until_full', str(tmp_path)])}"
    report = json.loads(subprocess.run([*IN_SMALL_DISK, command], capture_output=True, check=True, timeout=60).stdout)
    check_full(report, "No space left on device")
