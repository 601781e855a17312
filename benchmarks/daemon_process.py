"""The process under test: ``hapticd run`` exactly as a user starts it, beside an optional busy Python thread.

``python -m benchmarks.daemon_process THREADS_FILE {busy|calm} ARGUMENTS…`` hands the arguments to the command line of
hapticd. THREADS_FILE receives the kernel's number of every thread by its Python name, once the daemon answers.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path

from hapticd.cli.main import main


def _spin() -> None:
    number = 1
    while True:
        number = (number * 5 + 1) & 0xFFFF


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
    if load == "busy":
        threading.Thread(target=_spin, name="busy", daemon=True).start()
    threading.Thread(target=_name_threads, args=(Path(threads_file),), daemon=True).start()
    sys.exit(main(arguments))
