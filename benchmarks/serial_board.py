"""The simulated serial board at a servo rate: ``python benchmarks/serial_board.py [RATE_HZ] [SECONDS]``.

A host in C, which shares nothing with the drivers, does one exchange a period. Printed: what it missed, its round trips,
and the board's turnaround (receipt of the sample frame to reply handed to the line) from the board's own log.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from sim_hw.log import SAMPLE, WATCHDOG, read_log


def main() -> None:
    rate, seconds = (sys.argv[1:] + ["1000", "60"][len(sys.argv) - 1 :])[:2]
    with tempfile.TemporaryDirectory() as folder:
        host, link, log = (str(Path(folder) / name) for name in ("host", "board", "log"))
        source = Path(__file__).with_name("serial_host.c")
        subprocess.run(["cc", "-O2", "-o", host, str(source)], check=True)
        command = [sys.executable, "-m", "sim_hw", "serial", "--link", link, "--log", log]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as board:
            assert board.stdout is not None
            board.stdout.readline()
            try:
                print(subprocess.run([host, link, rate, seconds], check=True, capture_output=True, text=True).stdout)
            finally:
                board.terminate()
        rows = read_log(log)
    turnaround = rows["detail"][(rows["event"] == SAMPLE) & (rows["detail"] >= 0)] / 1e3
    p50, p99 = np.percentile(turnaround, [50, 99])
    trips = int((rows["event"] == WATCHDOG).sum())
    board_side = {"p50": round(p50, 1), "p99": round(p99, 1), "max": round(float(turnaround.max()), 1)}
    print(json.dumps({"board_turnaround_us": board_side, "samples": turnaround.size, "watchdog_trips": trips}))


if __name__ == "__main__":
    main()
