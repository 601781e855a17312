"""Which cases there are; how one is made, and how the workflow is asked."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.gap import tasks
from benchmarks.gap.cases import Files
from benchmarks.gap.foreign import nominal, record, truth
from benchmarks.gap.foreign.machines import FRICTIONS, MACHINES
from benchmarks.gap.foreign.simulate import play


@dataclass(frozen=True)
class Case:
    """One record."""

    seed: int
    number: int

    @property
    def name(self) -> str:
        """It says nothing of the truth."""
        return f"s{self.seed:03d}-{self.number:03d}"

    @property
    def excluded(self) -> tuple[str, ...]:
        """Names that are not allowed."""
        return ()

    @property
    def drawn(self) -> tuple[str, str, str]:
        """Machine, friction, fault: the machines by turns, and each seed has every pair of the others before one again."""
        index = self.number % len(MACHINES)
        pairs = np.random.default_rng([self.seed, index, 0xF0]).permutation(len(FRICTIONS) * len(record.FAULTS))
        friction, fault = divmod(int(pairs[self.number // len(MACHINES) % pairs.size]), len(record.FAULTS))
        machine, rubs = list(MACHINES)[index], FRICTIONS[friction]
        if machine == "slow_drive" and rubs != "presliding":
            rubs = "rising"
        return machine, rubs, list(record.FAULTS)[fault]


def make(case: Case) -> tuple[Files, dict[str, Any]]:
    """A case's files and its truth."""
    name, friction, fault = case.drawn
    rng = np.random.default_rng([case.seed, case.number, 0xF1])
    drawn = record.broken(MACHINES[name](friction, rng), fault, rng)
    motion = play(drawn.machine, drawn.loop, drawn.reference, drawn.feed, drawn.disturbance, drawn.tick_s, drawn.start)
    base = nominal.straight(drawn, motion)
    kind = str(rng.choice(nominal.KINDS))
    if name == "slow_drive" and case.number // len(MACHINES) % 2 == 0:  # its inertia is asked for
        kind = "guess"
    said, sure = nominal.drawn_base(base, kind, rng)
    rows = record.recorded(drawn, motion, fault, rng)
    model = nominal.config(drawn, said, sure)
    files = {
        **record.written(rows, drawn, rng),
        "model.yaml": yaml.safe_dump(model, sort_keys=False).encode(),
    }
    known = {
        "machine": name,
        "friction": friction,
        "fault": fault,
        "config": kind,
        "rate_hz": drawn.rate_hz,
        "rows": rows.stamp.size,
        "true": base._asdict(),
        "said": said._asdict(),
        **nominal.shares(drawn, motion, base, said),
        **truth.names(drawn, friction, fault),
        "device": drawn.machine._asdict(),
        "loop": drawn.loop._asdict(),
    }
    return files, plain(known)


def plain(value: Any) -> Any:
    """The same without numpy's types."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def answer(files: Files, excluded: Sequence[str] = ()) -> dict[str, Any]:
    """What the workflow answers, and the time it took."""
    return tasks.timed(ask, files)


def ask(folder: Path) -> dict[str, Any]:
    """Import the record in a folder and ask the workflow."""
    from hapticd.gap.call import find_gap
    from hapticd.record import import_run, load_map

    with tempfile.TemporaryDirectory(prefix="gap-") as own:
        run = Path(own) / "run.arrow"
        imported = import_run(folder / "record.csv", load_map(folder / "map.yaml"), run)
        found = find_gap([run], folder / "model.yaml").to_json()
    return {**found, "import_warnings": list(imported.warnings)}
