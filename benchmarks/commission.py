"""`hapticd commission` against seeded faults of wiring and config, and against good rigs drawn at random.

Every rig is the simulated RE35, or one like it, behind driver loopback: the device has a config file of its own, and the
rig's config says of it what a person believes. Found means: the first step that fails is the one where the fault shows. On a
good rig no step may fail.

    python -m benchmarks.commission                  13 faults and 20 good rigs: an hour
    python -m benchmarks.commission --without gap    half of that
    python -m benchmarks.commission --bench          only the steps before a daemon: half a minute

Steps before a daemon pass in virtual time, those with one in real time; both count as rig time.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapticd.commission.certificate import certificate
from hapticd.commission.rig import Given, Rig
from hapticd.commission.run import commission
from hapticd.commission.step import Result
from hapticd.commission.steps import NAMES
from hapticd.config import Config, apply_settings, config_to_yaml, parse_config

GOOD_RIGS: Final = 20
LIMIT_S: Final = 360.0
WATCHDOG_MS: Final = 50
LOAD: Final = 0.01
"""N m, of the weight that is hung on."""
BENCH: Final = (
    "doctor",
    "zero_current",
    "by_hand",
    "sign",
    "torque_constant",
    "latency",
    "watchdog",
    "enable",
    "current_loop",
)
"""Steps that hold the driver themselves."""


@dataclass(frozen=True)
class Seeded:
    """One fault, and the step that must find it.

    Attributes:
        config: settings of the rig's config that are wrong; device: of the device. wiring: option ``faults`` of loopback.
    """

    name: str
    step: str
    config: Mapping[str, Any] = field(default_factory=dict)
    device: Mapping[str, Any] = field(default_factory=dict)
    wiring: Mapping[str, Any] = field(default_factory=dict)


FAULTS: Final = (
    Seeded("motor leads exchanged", "sign", wiring={"current_gain": -1}),
    Seeded("encoder's A and B exchanged", "by_hand", device={"encoder.invert": True}),
    Seeded("lines taken for counts", "by_hand", config={"encoder.counts_per_rev": 2048}),
    Seeded("index not connected", "by_hand", wiring={"index": False}),
    Seeded("an encoder channel dead", "by_hand", wiring={"counts": False}),
    Seeded("ten times the rated current", "sign", wiring={"current_gain": 10}),
    Seeded("a motor lead off", "sign", wiring={"current_gain": 0}),
    Seeded("torque constant of another winding", "torque_constant", config={"amplifier.torque_constant": 0.0389}),
    Seeded("dead watchdog", "watchdog", wiring={"watchdog": False}),
    Seeded("enable switch bridged", "enable", wiring={"enable": False}),
    Seeded("a drive that is 3 ms late", "latency", wiring={"latency_s": 0.003}),
    Seeded("a slow current loop", "current_loop", device={"amplifier.bandwidth_hz": 300}),
    Seeded("rated current not known", "doctor", config={"amplifier.continuous_current": None}),
)


class Nobody:
    """Agrees to everything; the hand is the simulation's."""

    def agrees(self, question: str) -> bool:
        """Yes."""
        return True

    def does(self, request: str) -> bool:
        """Yes."""
        return True

    def shows(self, counts: int, rate: float, fastest: float) -> None:
        """Nothing."""


@contextlib.contextmanager
def no_bar(label: str) -> Iterator[Callable[[float], None]]:
    """No progress bar."""
    yield lambda fraction: None


def rig_of(believed: Config, real: Config, wiring: Mapping[str, Any], folder: Path, *, virtual: bool) -> Rig:
    """A rig whose config believes one thing and whose device is another."""
    device = folder / "device.yaml"
    device.write_text(config_to_yaml(real))
    data = believed.model_dump()
    data["safety"]["enable"] = True
    data["driver"] = {"name": "loopback", "device": str(device), "watchdog_ms": WATCHDOG_MS, "faults": dict(wiring)}
    config = parse_config(data, "the rig")
    return Rig(config, folder, Nobody(), lambda text: None, no_bar, Given(LOAD), virtual=virtual)


def seeded(fault: Seeded, folder: Path, *, virtual: bool = True) -> Rig:
    """The simulated RE35 with one fault."""
    right = parse_config({}, "RE35")
    believed, real = (
        apply_settings(right, dict(settings), source=fault.name) if settings else right
        for settings in (fault.config, fault.device)
    )
    return rig_of(believed, real, fault.wiring, folder, virtual=virtual)


def good(seed: int, folder: Path, *, virtual: bool) -> Rig:
    """A rig like the RE35, drawn at random, whose config is a data sheet's: right, but for its plant by some 15 %."""
    random = np.random.default_rng(seed)

    def times(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    right = parse_config({}, "RE35")
    real = {
        "plant.inertia": right.plant.inertia * times(0.5, 2.5),
        "plant.viscous": right.plant.viscous * times(0.5, 3.0),
        "plant.coulomb": right.plant.coulomb * times(0.5, 1.5),
        "amplifier.torque_constant": right.amplifier.torque_constant * times(0.8, 1.6),
        "amplifier.continuous_current": 2.0 * times(0.8, 1.5),
        "amplifier.bandwidth_hz": 3000.0 * times(0.5, 1.2),
        "encoder.counts_per_rev": float(random.choice([4096, 8192, 10000, 16384])),
    }
    believed = {**real, **{key: real[key] * times(0.87, 1.15) for key in real if key.startswith("plant.")}}
    device, config = (apply_settings(right, settings, source="drawn") for settings in (real, believed))
    return rig_of(config, device, {}, folder, virtual=virtual)


def first_failure(results: Mapping[str, Result]) -> str | None:
    """The first step that failed."""
    return next((name for name, result in results.items() if result.result == "fail"), None)


def main(arguments: list[str] | None = None) -> int:
    """Run it; 0 where every fault is found and no good rig fails."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.commission", description=__doc__)
    parser.add_argument("--bench", action="store_true", help="only the steps before a daemon, in virtual time")
    parser.add_argument("--without", action="append", default=[], choices=NAMES, help="leave out this step")
    parser.add_argument("--good", type=int, default=GOOD_RIGS, metavar="N", help="good rigs (default: 20)")
    options = parser.parse_args(arguments)
    found = 0
    for fault in FAULTS:
        with tempfile.TemporaryDirectory() as folder, seeded(fault, Path(folder)) as rig:
            step = first_failure(commission(rig, only=BENCH))
        found += step == fault.step
        print(
            f"{'found' if step == fault.step else 'MISSED':7} {fault.name}: at {step}, expected at {fault.step}",
            flush=True,
        )
    steps = BENCH if options.bench else NAMES
    false, disturbed, longest = 0, 0, 0.0
    for seed in range(options.good):
        with tempfile.TemporaryDirectory() as folder, good(seed, Path(folder), virtual=True) as rig:
            results = commission(rig, only=[name for name in steps if name not in options.without])
            step, longest = first_failure(results), max(longest, rig.seconds)
            document = {} if options.bench else certificate(rig)
        left = [f", {word} {', '.join(document[word])}" for word in ("skipped", "disturbed") if document.get(word)]
        false += step is not None
        disturbed += step is None and bool(document.get("disturbed"))
        said = f"FAILED at {step}: {results[step].finding}" if step else "no step failed"
        print(f"rig {seed:2}: {said}; {rig.seconds:.0f} s{''.join(left)}", flush=True)
    print(f"{found} of {len(FAULTS)} faults at the right step; {false} false on {options.good} good rigs, ", end="")
    print(f"{disturbed} not answered on a machine too busy; ", end="")
    print(f"at most {longest:.0f} s of rig time, {LIMIT_S:.0f} s allowed")
    return 0 if found == len(FAULTS) and not false and longest <= LIMIT_S else 1


if __name__ == "__main__":
    sys.exit(main())
