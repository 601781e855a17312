"""The pictures of the documentation, made by the project itself: `make docs`.

`images/fig8.png`: the four cases of the paper's Fig. 8, run by the daemon in real time on the simulated testbed, each drawn
over the exact simulation of the deflection that the daemon really achieved.

`images/missing-effect-*.png`: the story of docs/tutorials/missing-effect.md.

`images/take-the-model.png`: MuJoCo with a model before and after, for docs/how-to/take-the-model-with-you.md.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from figure_missing_effect import missing_effect
from figure_take_the_model import take_the_model

from hapticd.config import Config, parse_config
from hapticd.record import read_run
from hapticd.record.schema import FLAG_RUNNING
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.servo.simulate import simulate

IMAGES = Path(__file__).parent / "images"
CASES = (
    ("a", "region A: passive, comes to rest", 1000, 217, 20.3, 1.0),
    ("b", "region B: buzzes below one tick", 1000, 2172, 3.3, 2.5),
    ("c", "region E: low energy, comes to rest", 100, 217, 2.3, 0.4),
    ("d", "region D: high energy, runs away and is caught", 100, 217, 10.3, 1.0),
)
ATTEMPTS = 5
MEASURED, EXACT, TICK = "#0b5fa5", "#c0504d", "#8a8a8a"


def release(config: Config, deflection: float, duration_s: float) -> tuple[Any, dict[str, Any], int]:
    """One release by a daemon of its own; returns the run, the result and the missed periods."""
    daemon = Daemon(config, None, FaultLatch(Path("figures.sock")))
    try:
        daemon.release(deflection, duration_s, force=True)
        while daemon.experiment()["state"] == "running":
            time.sleep(0.05)
        result = daemon.experiment()["result"]
        return read_run(Path(result["run"])), result, daemon.status()["timing"]["missed"]
    finally:
        daemon.clear()
        daemon.shutdown()


def fig8(folder: Path) -> None:
    """Run and draw the four cases."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(10, 6), constrained_layout=True)
    for (name, meaning, rate, decimation, deflection, duration), axis in zip(CASES, axes.flat, strict=True):
        config = parse_config(
            {
                "servo": {"rate_hz": rate},
                "encoder": {"decimation": decimation},
                "amplifier": {"bandwidth_hz": 0, "dac_bits": 0},
                "record": {"directory": str(folder)},
            },
            "fig8",
        )
        for attempt in range(1, ATTEMPTS + 1):
            run, result, missed = release(config, deflection, duration)
            print(f"{name}: {result['outcome']}, missed periods {missed}, attempt {attempt}", flush=True)
            if missed == 0:
                break
        running = run.columns["flags"] & FLAG_RUNNING != 0
        time_s = run.columns["time_s"][running]
        ticks = (run.columns["encoder_counts"][running] - run.metadata["origin_counts"]) / decimation
        achieved = result["achieved_deflection"]
        blocks: list[Any] = []
        simulate(config, duration, deflection=achieved, on_rows=lambda rows: blocks.append(rows.copy()))  # noqa: B023
        exact = np.concatenate(blocks)[: len(time_s)]
        axis.axhspan(-1, 1, color=TICK, alpha=0.15, lw=0)
        axis.plot(time_s - time_s[0], ticks, color=MEASURED, lw=1.6, label="daemon, real time")
        axis.plot(exact["time_s"], exact["encoder_counts"] / decimation, color=EXACT, lw=0.9, ls="--", label="exact")
        axis.set_title(f"({name}) {meaning}", fontsize=10, loc="left")
        axis.set_xlabel("time (s)")
        axis.set_ylabel("coarse ticks")
        axis.margins(x=0.01)
        if name == "b":
            inset = axis.inset_axes((0.5, 0.6, 0.46, 0.32))
            last = time_s - time_s[0] > duration - 0.1
            inset.plot((time_s - time_s[0])[last], ticks[last], color=MEASURED, lw=1.2)
            inset.set_title("the last 0.1 s", fontsize=8)
            inset.tick_params(labelsize=7)
        if "fault" in result:
            axis.annotate(
                f"fault {result['fault']}: zero current",
                (time_s[-1] - time_s[0], ticks[-1]),
                (0.03, 0.08),
                textcoords="axes fraction",
                fontsize=8,
            )
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.savefig(IMAGES / "fig8.png", dpi=110)


def main() -> None:
    """Make every picture."""
    mpl.use("agg")
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = folder
        fig8(Path(folder))
    missing_effect(IMAGES)
    take_the_model(IMAGES)


if __name__ == "__main__":
    main()
