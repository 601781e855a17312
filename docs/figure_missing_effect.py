"""The pictures of docs/tutorials/missing-effect.md: the device beside both models, and the missing force."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

from hapticd.config import load_config
from hapticd.figures.style import style
from hapticd.gap.figures import over_time
from hapticd.hil.compare import Trace
from hapticd.servo.experiment import read_experiment
from tests.gap.hidden_effect import Story, find_hidden_effect

EXAMPLE = Path(__file__).parents[1] / "examples" / "missing_effect"
DEFLECTION, SHOWN_TICKS = 31.3, 100.0
DEVICE, BEFORE, AFTER = "#0b5fa5", "#8a8a8a", "#c0504d"


def missing_effect(images: Path) -> None:
    """Live the story on simulated hardware and draw it; takes one or two minutes."""
    model, secret = load_config(EXAMPLE / "model.yaml"), load_config(EXAMPLE / "secret.yaml")
    with tempfile.TemporaryDirectory(prefix="hf-") as folder:
        story = find_hidden_effect(
            model, secret, read_experiment(EXAMPLE / "first.yaml"), DEFLECTION, Path(folder), say=print
        )
        document = json.loads((Path(folder) / "gap" / "gap.json").read_text())
    print(document["verdict"], document["statement"])
    _release(story, images / "missing-effect-release.png")
    _gap(story, images / "missing-effect-gap.png")


def _release(story: Story, path: Path) -> None:
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(8, 3.6), constrained_layout=True)
    measured = story.nominal.comparison.measured
    for trace, color, dashes, width, label in (
        (measured, DEVICE, "-", 1.8, f"device: {story.outcome}"),
        (story.nominal.comparison.simulated, BEFORE, "-", 1.2, f"nominal model: {story.nominal.outcome}"),
        (story.improved.comparison.simulated, AFTER, "--", 1.2, f"improved model: {story.improved.outcome}"),
    ):
        time_s, ticks = _shown(trace, measured.time_s[-1])
        axis.plot(time_s, ticks, color=color, ls=dashes, lw=width, label=label)
    axis.set_ylim(-SHOWN_TICKS, SHOWN_TICKS)
    axis.set_xlabel("time (s)")
    axis.set_ylabel("coarse ticks")
    axis.margins(x=0.01)
    axis.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0, ncols=3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _shown(trace: Trace, end_s: float) -> tuple[object, object]:
    rows = trace.time_s <= end_s
    return trace.time_s[rows], trace.ticks[rows]


def _gap(story: Story, path: Path) -> None:
    result = story.result
    # A run's file has the instant in its name, which says nothing here.
    profiles = [replace(profile, name=Path(profile.name).stem.partition("Z-")[2]) for profile in result.profiles]
    with style():
        over_time(profiles, result.gap.unit, result.gap.noise_floor).savefig(path, dpi=110)
