"""The picture of docs/how-to/take-the-model-with-you.md: MuJoCo with the model as it was, and with what was found.

A device that the model does not know, a handle out of balance on a shaft whose friction rises at rest, is driven by a sum of
sines. `hapticd.find_gap` says what is missing in its first ten seconds; both models go to MuJoCo, and have the commands of
two seconds more, from the same state and with nothing else.
"""

from __future__ import annotations

import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import hapticd
from hapticd.config import Config, parse_config
from hapticd.export import write_model
from hapticd.plant import Plant

if TYPE_CHECKING:
    from numpy.typing import NDArray

KNOWN = {"inertia": 6.28e-6, "viscous": 9e-6, "coulomb": 2e-3}
SECRET = [{"name": "gravity", "m_g_l": 4e-3, "theta_0": 0.2}, {"name": "stribeck", "s": 0.6, "omega_s": 4.0}]
AMPLIFIER = {"bandwidth_hz": 0, "dac_bits": 0}
FITTED_S, SHOWN_S, PERIOD_S = 10.0, 2.0, 1e-3
DEVICE, BEFORE, AFTER = "#0b5fa5", "#8a8a8a", "#c0504d"


def commands() -> NDArray[np.float64]:
    """Twelve seconds, A."""
    t = np.arange(round((FITTED_S + SHOWN_S) / PERIOD_S)) * PERIOD_S
    waves = ((0.06, 0.7, 0.0), (0.06, 1.9, 1.0), (0.08, 4.3, 2.0), (0.08, 9.1, 0.5))
    return np.sum([size * np.sin(2 * np.pi * f * t + phase) for size, f, phase in waves], axis=0)


def take_the_model(images: Path) -> None:
    """Record, ask, export, simulate and draw; a minute or two."""
    known = parse_config({"plant": KNOWN, "amplifier": AMPLIFIER}, "model")
    device = Plant.from_config(parse_config({"plant": {**KNOWN, "effects": SECRET}, "amplifier": AMPLIFIER}, "device"))
    current = commands()
    counts, true = [], []
    for k, command in enumerate(current.tolist()):
        counts.append(device.counts)
        true.append((device.position, device.velocity))
        device.command(command, k * PERIOD_S)
        device.advance((k + 1) * PERIOD_S)
    begin = round(FITTED_S / PERIOD_S)
    with tempfile.TemporaryDirectory(prefix="hf-") as name:
        folder = Path(name)
        rows = np.column_stack([np.arange(begin) * PERIOD_S, counts[:begin], current[:begin]])
        header = "time_s,encoder_counts,current_command_A"
        np.savetxt(folder / "run.csv", rows, "%.6f,%d,%.9f", header=header, comments="")
        result = hapticd.find_gap(folder / "run.csv", known, out=folder / "gap")
        print(result.verdict, result.statement)
        improved = hapticd.load_config(folder / "gap" / "model.yaml")
        motions = {
            label: in_mujoco(config, folder / f"{label}.xml", true[begin], current[begin:])
            for label, config in (("before", known), ("after", improved))
        }
    draw(np.array([x for x, _ in true[begin:]]), motions, result.steps, images / "take-the-model.png")


def in_mujoco(
    config: Config, path: Path, state: tuple[float, float], current: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Positions in MuJoCo at each command, from a state on."""
    import mujoco

    files = write_model(config, "mjcf", path)
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    mujoco.set_mjcb_passive(None)
    if len(files) > 1:
        sys.path.insert(0, str(path.parent))
        import_module(files[1].stem).install(model)
        sys.path.pop(0)
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = state
    positions = []
    for command in current.tolist():
        positions.append(float(data.qpos[0]))
        data.ctrl[0] = command
        for _ in range(round(PERIOD_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
    mujoco.set_mjcb_passive(None)
    return np.array(positions)


def draw(device: NDArray[np.float64], motions: dict[str, NDArray[np.float64]], steps: Any, path: Path) -> None:
    """The device and MuJoCo's two motions, and their errors beneath."""
    from matplotlib import pyplot as plt

    found = " and ".join(sorted(step.effect for step in steps))
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(8, 5), sharex=True, height_ratios=(2, 1), constrained_layout=True
    )
    t = FITTED_S + np.arange(len(device)) * PERIOD_S
    above.plot(t, device, color=DEVICE, lw=2.2, label="device")
    for label, color, text in (
        ("before", BEFORE, "MuJoCo, the model as given"),
        ("after", AFTER, f"MuJoCo, with {found}"),
    ):
        error = motions[label] - device
        rms = float(np.sqrt(np.mean(error**2)))
        print(f"{label}: off by {rms:.3g} rad")
        above.plot(t, motions[label], color=color, lw=1.2, ls="--" if label == "after" else "-", label=text)
        below.plot(t, error, color=color, lw=1.2, label=f"RMS {rms:.2g} rad")
    above.set_ylabel("position (rad)")
    below.set_ylabel("error (rad)")
    below.set_xlabel("time (s)")
    for axis in (above, below):
        axis.margins(x=0.01)
        axis.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0, ncols=3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    take_the_model(Path(__file__).parent / "images")
