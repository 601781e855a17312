"""``hapticd model export``: the model for other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.options import ConfigArgument, SettingsOption, resolve_config


@command(
    "hapticd model export gap/model.yaml --to mjcf",
    "hapticd model export rig.yaml --to python -o rig_model.py",
    "hapticd model export rig.yaml --to fmu --force",
)
def export(
    config: ConfigArgument = None,
    *,
    to: Literal["mjcf", "urdf", "fmu", "python"],
    out: Path | None = None,
    force: bool = False,
    assignments: SettingsOption = None,
) -> None:
    """Write the plant of a config, with its effects and its amplifier, for another simulator.

    mjcf is for MuJoCo; what MJCF cannot say is in a Python module beside it, NAME_mujoco.py: 'import NAME_mujoco;
    NAME_mujoco.install(model)'. urdf is one joint with damping, friction and limits. fmu is a co-simulation FMU of FMI 2.0;
    who runs it needs Python, but not hapticd. python is a module of the standard library alone, with a stepper and torque(x,
    v, i, t).

    Of every effect it says whether the format has it exactly, approximately or not at all. An fmu needs PythonFMU: pip
    install 'hapticd[export]'.

    Args:
        to: Format: mjcf, urdf, fmu or python.
        out (-o, --output FILE): File to write. Default: CONFIG with the suffix .xml, .urdf, .fmu or .py.
        force: Replace FILE, and the module beside it, if they exist.
    """
    resolved = resolve_config(config, assignments)
    from hapticd.export import SUFFIXES, module_beside, sayings, write_model
    from hapticd.export.head import doubts
    from hapticd.figures.files import refuse_existing

    source = Path(config) if config is not None else Path("re35")
    target = out or source.with_suffix(SUFFIXES[to])
    refuse_existing(target, force=force, source=source)
    if to == "mjcf":
        refuse_existing(module_beside(target), force=force, source=source)
    files = write_model(resolved, to, target)
    said = sayings([effect.name for effect in resolved.plant.effects], to)
    loss = None
    lines = [f"{files[0]}" + "".join(f", and beside it {path}" for path in files[1:])]
    for slug, saying in said.items():
        where = f" in {saying.where}" if saying.where else ""
        lines.append(f"  {slug}: {saying.how}{where}{f': {saying.why}' if saying.why else ''}")
    if to == "fmu":
        lines.append("  the target needs Python 3.9 or later")
    elif to == "urdf":
        from hapticd.export.loss import loss_of_urdf

        loss = loss_of_urdf(resolved)
        lines.append(f"  {loss.text}")
        lines.append(
            "  the joint takes a torque or force: torque constant, delay, current loop and converter are left out"
        )
    document = {
        "output": files[0],
        "files": files,
        "format": to,
        "effects": [
            {"effect": slug, "how": saying.how, "where": saying.where, "why": saying.why}
            for slug, saying in said.items()
        ],
        "needs_python": to in ("fmu", "python") or len(files) > 1,
    }
    if loss is not None:
        document["loss"] = {"share_of_travel": loss.share, "current_A": loss.current_A}
    output.emit(document, "\n".join(lines))
    for doubt in doubts(resolved):
        output.warn(f"warning: {doubt}")
    if lost := [slug for slug, saying in said.items() if saying.how == "refused"]:
        output.warn(f"left out: {', '.join(lost)}")
