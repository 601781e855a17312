"""Rows lost when the daemon is killed: its servo thread at 10 kHz on the loopback, killed at random instants.

``python -m tests.service.kills [--kills N] [--how kill|segv|oom]``. Each trial is a process of its own: rig, servo thread,
recorder and flight recorder as the daemon makes them. What the device saw is the witness: between loop and loopback a
compiled function notes, in memory of the parent's, the tick whose command was just written. When that of tick n was, the
servo had finished every tick before n, so each of them must be in the recovered run.
"""

from __future__ import annotations

import argparse
import ctypes
import faulthandler
import json
import mmap
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

import drivers
from drivers.interface import EXCHANGE_WORDS, X_TICK
from drivers.loopback import LoopbackDriver
from hapticd.config import Config, parse_config
from hapticd.jit import call_driver, carray, cfunc
from hapticd.record import read_run
from hapticd.record.schema import FLAG_MISSED_PERIOD
from hapticd.service import flight
from hapticd.service.rig import Rig
from hapticd.servo.authority import Authority

RATE_HZ = 10_000
READ, WRITE, STATE, LAST, BEFORE, WRITES = range(6)
SIZE = 6
"""Words of the witness: the loopback's functions and state; the last two ticks whose commands are out; how many are."""
_LONGEST_S = 1.0
_OOM_LIMIT = 400 << 20
_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))


@cfunc(_SIGNATURE)
def _write(state: int, exchange: int) -> int:
    witness = carray(state, (SIZE,))
    x = carray(exchange, (EXCHANGE_WORDS,))
    result = call_driver(witness[WRITE], witness[STATE], x.ctypes.data)
    witness[BEFORE] = witness[LAST]
    witness[LAST] = x[X_TICK]
    witness[WRITES] += 1
    return int(result)


@cfunc(_SIGNATURE)
def _read(state: int, exchange: int) -> int:
    witness = carray(state, (SIZE,))
    return int(call_driver(witness[READ], witness[STATE], carray(exchange, (EXCHANGE_WORDS,)).ctypes.data))


class WitnessedLoopback(LoopbackDriver):
    witness: NDArray[np.int64]

    def open(self) -> None:
        super().open()
        self.witness[[READ, WRITE, STATE]] = self.read_address, self.write_address, self.state_address
        self.read_address, self.write_address = _read.address, _write.address
        self.state_address = self.witness.ctypes.data


def _config(folder: Path) -> Config:
    return parse_config(
        {
            "servo": {"rate_hz": RATE_HZ, "overrun": {"fault_after": None}},
            "safety": {"heartbeat_timeout_s": 10},
            "record": {"directory": str(folder / "runs")},
        },
        "the trial's config",
    )


def _live(config: Config, witness: NDArray[np.int64], how: str) -> None:
    """The child: render and record until killed."""
    WitnessedLoopback.witness = witness
    drivers.create = WitnessedLoopback  # type: ignore[assignment]
    rig = Rig(config, name="kills")
    rig.recorder.start(None, "kills")
    rig.run(Authority().arrived(1.0))
    faulthandler.disable()
    if how == "segv":
        time.sleep(random.uniform(0.05, _LONGEST_S))
        ctypes.string_at(0)
    hoard = []
    while True:
        rig.servo.beat()
        time.sleep(0.005)
        if how == "oom":
            hoard.append(b"x" * (8 << 20))


def _trial(folder: Path, how: str, chance: random.Random) -> dict[str, Any]:
    """One life and death; what the witness saw against what was recovered."""
    shared = mmap.mmap(-1, 4096)
    witness = np.frombuffer(shared, np.int64)
    config = _config(folder)
    place = flight.flight_directory(config)
    if place is None:
        sys.exit("no file system in memory here")
    child = os.fork()
    if child == 0:
        try:
            if how == "oom":
                _join_small_group()
            _live(config, witness, how)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    deadline = time.monotonic() + 60
    while witness[WRITES] < 100 and time.monotonic() < deadline:
        time.sleep(0.01)
    if how == "kill":
        time.sleep(chance.uniform(0.0, _LONGEST_S))
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    (found,) = flight.recover(place, "kills")
    run = read_run(found.run)
    tick, flags = run.columns["tick"], run.columns["flags"]
    gaps = (np.diff(tick) > 1) & ((flags[1:] & FLAG_MISSED_PERIOD) == 0)
    lost = int(np.sum((np.diff(tick) - 1)[gaps])) + max(0, int(witness[BEFORE]) - int(tick[-1]))
    # Every tick writes once; a life is shorter than what the flight recorder holds.
    lost = max(lost, int(witness[WRITES]) - 1 - run.rows)
    for left in (folder / "runs").iterdir():
        left.unlink()
    return {"signal": os.WTERMSIG(status), "rows": run.rows, "writes": int(witness[WRITES]), "lost": lost}


def _join_small_group() -> None:
    """A control group of the memory controller that this process outgrows: the kernel's own out-of-memory kill."""
    old = Path("/sys/fs/cgroup/memory")
    group = (old if old.is_dir() else old.parent) / "hapticd-kills"
    group.mkdir(exist_ok=True)
    (group / ("memory.limit_in_bytes" if old.is_dir() else "memory.max")).write_text(str(_OOM_LIMIT))
    (group / "cgroup.procs").write_text(str(os.getpid()))


def main() -> int:
    """Run it; 1 when a row was lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.service.kills", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--how", choices=("kill", "segv", "oom"), default="kill")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="hapticd-kills-") as name:
        done = [_trial(Path(name), options.how, chance) for _ in range(options.kills)]
    found = {key: sum(trial[key] for trial in done) for key in ("rows", "lost")}
    ends = sorted({signal.Signals(trial["signal"]).name for trial in done})
    print(json.dumps({"kills": len(done), "rate_hz": RATE_HZ, "signals": ends, **found}))
    return 1 if found["lost"] else 0


if __name__ == "__main__":
    sys.exit(main())
