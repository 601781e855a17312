"""A joint's limits in a URDF, held against what was imported: a wrong unit, a measured command, a drive at its end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from hapticd.config.nearest import nearest_name
from hapticd.config.opening import open_regular
from hapticd.record import RunFileError, read_run
from hapticd.robots._reference import Reference

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.record import Imported
    from hapticd.record.importing_map import ImportMap

    Floats = NDArray[np.float64]

_MOST_BYTES: Final = 1 << 24
_TURNS, _SLIDES = ("revolute", "continuous"), ("prismatic",)
_BEYOND: Final = 1.02
_AT_LIMIT: Final = 0.995
_WINDOW_S: Final = 0.02
"""Over which a speed is taken, less one count: so fast it was at least."""


@dataclass(frozen=True)
class Limits:
    """What a URDF says of a joint: N m or N, and rad/s or m/s; infinite where it says nothing."""

    file: str
    joint: str
    effort: float
    velocity: float


def limits_of(mapping: ImportMap) -> Limits | None:
    """The limits of the joint that a map names, or whose position it takes; None where it names no URDF.

    Raises:
        RunFileError: the file is no URDF, has no such joint, or one that does not move as the map's device does.
    """
    if mapping.urdf is None:
        return None
    file, kinds = mapping.urdf.file, _SLIDES if mapping.is_linear else _TURNS
    try:
        with open_regular(file) as opened:
            text = opened.read(_MOST_BYTES + 1)
        if len(text) > _MOST_BYTES or b"<!ENTITY" in text:
            raise RunFileError(f"{file} is no URDF: it has more than {_MOST_BYTES >> 20} MiB, or entities")
        root = ElementTree.fromstring(text)  # noqa: S314 - no entities, and no more than was read
    except (OSError, ElementTree.ParseError) as error:
        raise RunFileError(f"{file} is not a readable URDF: {getattr(error, 'strerror', None) or error}") from error
    joints = {joint.get("name", ""): joint for joint in root.iter("joint") if joint.get("type") in (*_TURNS, *_SLIDES)}
    name = mapping.urdf.joint or Reference.of(str(mapping.position.column)).rest.removesuffix(".position")
    if mapping.urdf.joint is None and len(joints) == 1:
        (name,) = joints
    if name not in joints:
        near = nearest_name(name, list(joints))
        hint = f"did you mean {near}? " if near else ""
        raise RunFileError(f"{file} has no joint {name!r} that moves; {hint}urdf.joint is one of {', '.join(joints)}")
    if joints[name].get("type") not in kinds:
        raise RunFileError(f"{file}: joint {name} is {joints[name].get('type')}, but device = {mapping.device}")
    found = joints[name].find("limit")
    try:
        effort, velocity = (float("nan" if found is None else found.get(key, "nan")) for key in ("effort", "velocity"))
    except ValueError as error:
        raise RunFileError(f"{file}: joint {name}: <limit>: {error}") from error
    # 0 is what exporters write where nobody knew
    return Limits(file, name, *(value if value > 0.0 else math.inf for value in (effort, velocity)))


def hold_against(done: Imported, limits: Limits) -> Imported:
    """What was imported, with hints for a config, and a warning where it is not within the limits."""
    columns = read_run(done.path).columns
    turn, force = ("m/s", "N") if done.is_linear else ("rad/s", "N m")
    said = f"{limits.file} limits {limits.joint} to"
    warnings, hints = [], {}
    driven = np.abs(columns["force_command"])
    if math.isfinite(limits.effort) and np.isfinite(driven).all():
        largest, at_end = float(driven.max()), int(np.count_nonzero(driven >= _AT_LIMIT * limits.effort))
        constant = float(np.nanmedian(driven / np.maximum(np.abs(columns["current_command_A"]), 1e-300)))
        if constant > 0.0:
            hints["amplifier.peak_current"] = limits.effort / constant
        if largest > _BEYOND * limits.effort:
            warnings.append(
                f"{said} {limits.effort:g} {force}, and the command reaches {largest:.4g}: is its unit right, and is it "
                "the joint's?"
            )
        elif at_end:
            warnings.append(
                f"{said} {limits.effort:g} {force}, and {at_end} rows are at it: the drive may have cut them"
            )
    if math.isfinite(limits.velocity):
        hints["safety.max_velocity"] = limits.velocity
        fastest = _fastest(columns["time_s"], columns["encoder_counts"] * done.resolution, done.resolution)
        if fastest > _BEYOND * limits.velocity:
            warnings.append(f"{said} {limits.velocity:g} {turn}, and it moves at {fastest:.4g}: are their units right?")
    return replace(done, hints=hints, warnings=(*done.warnings, *warnings))


def _fastest(time_s: Floats, position: Floats, count: float) -> float:
    """The least speed that the largest change within a window can have been."""
    ahead = np.searchsorted(time_s, time_s + _WINDOW_S)
    inside = ahead < time_s.size
    way = np.abs(position[ahead[inside]] - position[inside]) - count
    span = time_s[ahead[inside]] - time_s[inside]
    return float(np.max(way / span, initial=0.0))
