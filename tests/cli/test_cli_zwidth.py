"""``hapticd zwidth``: which stiffness and damping can be rendered, by every measure."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import apply_settings, load_config
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.outcome import GROWING
from hapticd.stability.sampled_loop import run_loops
from hapticd.stability.zwidth import BUZZES, UNSTABLE, VERDICTS, ZWidth, motions, top_speed, zwidth

from .conftest import Run

COUNT = 10


@pytest.fixture(scope="module")
def phantom() -> ZWidth:
    return zwidth(load_config("phantom"), 0.0, count=COUNT, jobs=1)


def test_it_agrees_with_what_is_known_of_it(phantom: ZWidth) -> None:
    # what is proven is calm, and so is most of what the linear loop damps; far beyond that all grows
    proven = phantom.stiffness <= phantom.proven[:, None]
    assert (phantom.outcome[proven] <= BUZZES).all()
    assert (phantom.proven <= phantom.exact + 1e-9).all()
    beyond = phantom.stiffness > 1.2 * phantom.linear[:, None] + 0.05 * phantom.stiffness[-1]
    assert beyond.any()
    assert (phantom.outcome[beyond] == UNSTABLE).all()
    assert 0.3 * phantom.linear.max() < phantom.exact.max() < 1.2 * phantom.linear.max()
    # no hand is the worst of them, and with more of the hand more can be rendered
    most = [held.linear.max() for held in phantom.held]
    assert most == sorted(most)
    np.testing.assert_array_equal(phantom.linear, phantom.held[0].linear)


def test_the_speeds_are_those_that_the_limits_admit(phantom: ZWidth) -> None:
    assert phantom.fastest == pytest.approx(2.0)
    config, loop, K, B = phantom.config, phantom.held[0].loop, np.array(1015.0), np.array(0.0)
    reach = math.sqrt(loop.inertia / 1015.0)
    assert top_speed(config, loop, B, K) == 2.0
    near = apply_settings(config, {"safety.max_excursion": 0.005})
    assert top_speed(near, loop, B, K) == pytest.approx(0.005 / reach)
    weak = apply_settings(config, {"amplifier.peak_current": 3.0})
    assert top_speed(weak, loop, B, K) == pytest.approx(3.0 / (1015.0 * reach))
    assert top_speed(weak, loop, np.array(6.0), K) == pytest.approx(3.0 / math.hypot(1015.0 * reach, 6.0))
    free = apply_settings(config, {"safety.max_velocity": None, "safety.max_excursion": None})
    assert top_speed(free, loop, B, K, 0.1) == 0.1
    assert top_speed(free, loop, B, K) == pytest.approx(1000 * 29.1e-6 / 1e-3)


def test_the_worst_speed_decides() -> None:
    """Without damping Coulomb friction holds a slow motion and not a fast one: Table II's 1015 N/m is for slow ones."""
    config = load_config("phantom")
    axes = {"count": 4, "damping_max": 0.1, "stiffness_max": 1015.0, "jobs": 1}
    slow, fast = zwidth(config, 0.0, velocity=0.03, **axes), zwidth(config, 0.0, **axes)
    assert (slow.outcome[0] <= BUZZES).all()
    assert (fast.outcome[0] == UNSTABLE).all()
    assert slow.exact[0] == 1015.0
    assert 0.0 < fast.exact[0] < 0.1 * slow.exact[0]


def test_no_start_grows_from_a_point_that_is_calm(phantom: ZWidth) -> None:
    """Other starts than its own, drawn evenly from what the limits admit, in the bare device."""
    random = np.random.default_rng(7)
    config = phantom.config
    loop = loop_from_config(config)
    calm = np.argwhere(phantom.outcome <= BUZZES)
    assert calm.size
    for i, j in random.permutation(calm)[:12].tolist():
        K, B = float(phantom.stiffness[j]), float(phantom.damping[i])
        fastest = float(loop.scales.velocity_to_xi_dot(top_speed(config, loop, np.array(B), np.array(K))))
        starts = motions(loop, (1, 0.0), np.full(20, B), np.full(20, K))
        starts["xi"], starts["xi_dot"] = random.uniform(0, 1, 20), random.uniform(-fastest, fastest, 20)
        runs = run_loops(starts, 20_000)
        assert not ((runs["outcome"] == GROWING) & (runs["amplitude"] >= 1.0)).any()


def test_the_document_and_the_figure(hapticd: Run, tmp_path: Path) -> None:
    out = tmp_path / "z.svg"
    words = ("zwidth", "omega", "--points", "4", "--velocity", "0.2m/s", "--set", "spring.velocity_periods=3")
    answer = hapticd(*words, "-o", str(out), "--json")
    document = answer.document
    assert answer.code == 0
    assert out.stat().st_size > 10_000
    assert document["figure"] == str(out)
    assert len(document["rows"]) == 16
    assert set(document["rows"][0]) == {"stiffness", "damping", "verdict", "proven"}
    assert {row["verdict"] for row in document["rows"]} <= set(VERDICTS)
    assert set(document["boundary"]) == {"linear", "exact"}
    for line in document["boundary"].values():
        assert [point["damping"] for point in line] == sorted({row["damping"] for row in document["rows"]})
    assert document["fastest"] == pytest.approx(0.2)
    assert document["largest"]["linear"]["stiffness"] > document["largest"]["passive"]["stiffness"] > 0.0


def test_a_rotary_device_is_held_by_a_handle_and_by_the_configs_hand(hapticd: Run) -> None:
    words = (
        "zwidth",
        "--points",
        "2",
        "--velocity",
        "1rad/s",
        "--radius",
        "0.1",
        "--set",
        "hand.damping=2e-5",
        "--json",
    )
    hands: list[dict[str, Any]] = hapticd(*words).document["hands"]
    assert [hand["name"] for hand in hands][::4] == ["no hand", "the config's hand"]
    assert hands[0]["inertia"] == hands[0]["damping"] == 0.0
    assert hands[3]["inertia"] == pytest.approx(0.150 * 0.1**2)
    assert hands[4]["damping"] == 2e-5


def test_the_text_is_a_table(hapticd: Run) -> None:
    lines = hapticd("zwidth", "omega", "--points", "2", "--velocity", "0.1m/s").out.splitlines()
    assert lines[0].startswith("Z-width of omega: 4 points of (B, K), each in 4 hands at 5 speeds up to 0.1 m/s")
    assert [line.split("  ")[0] for line in lines[2:6]] == [
        "linear loop (Hulin)",
        "exact, calm",
        "proven",
        "passive, no hand",
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--velocity", "0"), "--velocity must be above 0"),
        (("--velocity", "1m/s"), "the device is rotary"),
        (("-o", "z.gif"), "a figure is a"),
        (("--points", "1"), "greater than or equal to 2"),
        (("--radius", "0"), "not above zero"),
        (("--set", "spring.stifness=1"), "spring.stiffness"),
    ],
)
def test_what_cannot_be_is_refused_before_any_work(hapticd: Run, words: tuple[str, ...], said: str) -> None:
    answer = hapticd("zwidth", "re35", *words)
    assert answer.code == 2
    assert said in answer.err


INTERRUPTED = """
import sys
from hapticd.cli.main import main
from hapticd.stability import zwidth
run = zwidth.run_in_threads
def said(*words):
    print("running", file=sys.stderr, flush=True)
    return run(*words)
zwidth.run_in_threads = said
sys.exit(main(["zwidth", "omega", "--points", "300"]))
"""


def test_ctrl_c_ends_it() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    while process.stderr.readline() != "running\n":
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
