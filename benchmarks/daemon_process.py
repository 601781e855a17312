"""The process under test: ``hapticd run`` exactly as a user starts it, beside an optional busy Python thread.

``python -m benchmarks.daemon_process THREADS_FILE {busy|calm} ARGUMENTS…`` hands the arguments to the command line of
hapticd. THREADS_FILE receives the kernel's number of every thread by its Python name, once the daemon answers. From the pipe
``switches`` beside it come JSON documents of what the daemon does by itself from now on (`Switches`).
"""

from __future__ import annotations

import gc
import json
import sys
import threading
import time
from pathlib import Path
from typing import TypedDict

from hapticd.cli.main import main
from hapticd.record import recorder
from hapticd.service import daemon


class Switches(TypedDict, total=False):
    """What can be changed while it runs: the busy thread, seconds between two wake-ups, garbage collection."""

    busy: bool
    recorder_s: float
    beat_s: float
    gc: bool


def _spin(wanted: threading.Event) -> None:
    number = 1
    while wanted.wait():
        for _ in range(1000):
            number = (number * 5 + 1) & 0xFFFF


def _obey(pipe: Path, wanted: threading.Event) -> None:
    while True:
        given: Switches = json.loads(pipe.read_text())
        if "busy" in given:
            (wanted.set if given["busy"] else wanted.clear)()
        if "gc" in given:
            (gc.enable if given["gc"] else gc.disable)()
        recorder.POLL_S = given.get("recorder_s", recorder.POLL_S)
        daemon._BEAT_S = given.get("beat_s", daemon._BEAT_S)


def _name_threads(path: Path) -> None:
    found: dict[str, int] = {}
    while not found.keys() >= {"hapticd-servo", "hapticd-recorder", "hapticd-api"}:
        time.sleep(0.05)
        found = {thread.name: thread.native_id for thread in threading.enumerate() if thread.native_id is not None}
    temporary = path.with_suffix(".new")
    temporary.write_text(json.dumps(found))
    temporary.replace(path)


if __name__ == "__main__":
    threads_file, load, *arguments = sys.argv[1:]
    wanted = threading.Event()
    if load == "busy":
        wanted.set()
    threading.Thread(target=_spin, args=(wanted,), name="busy", daemon=True).start()
    pipe = Path(threads_file).with_name("switches")
    threading.Thread(target=_obey, args=(pipe, wanted), name="switches", daemon=True).start()
    threading.Thread(target=_name_threads, args=(Path(threads_file),), daemon=True).start()
    sys.exit(main(arguments))
