"""Vendor profiles: a drive's objects and their meaning, in a YAML file.

The driver contains ``profiles/copley.yaml`` and ``profiles/cia402.yaml``; for another vendor write another file
(``driver.profile: /path/of/mine.yaml``). Every key is described in docs/reference/canopen-profile.md.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.interface import DriverConfigError
from hapticd.config import ConfigError
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown

FOLDER: Final = Path(__file__).parent / "profiles"

Index = Annotated[int, Field(ge=0x1000, le=0xFFFF)]
Unit = Literal["centiampere", "milliampere", "permille_rated_torque", "permille_rated_current"]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Setting(_Part):
    """One object that bring-up writes and reads back."""

    object: Index
    sub: Annotated[int, Field(ge=0, le=255)] = 0
    value: int
    what: str
    """Name with the unit, for error texts."""
    optional: bool = False
    """Skipped if the EDS or the drive does not have it."""


class Quantity(_Part):
    """An object with a current or a torque, and its unit."""

    object: Index
    unit: Unit


class LimitSetting(_Part):
    """A limit of the drive, set from a key of the config's amplifier section."""

    object: Index
    key: Literal["peak_current", "continuous_current", "peak_time_s"]
    unit: Literal["centiampere", "milliampere", "permille_rated_torque", "permille_rated_current", "ms"]
    what: str
    optional: bool = False


class Mode(_Part):
    """One mode in which a current can be commanded."""

    name: str
    requires_mode: Annotated[int, Field(ge=1, le=32)] | None = None
    """Number of the mode of operation that the drive's supported modes must offer."""
    target: Quantity
    demand: Quantity | None = None
    """Object with the demand after limits and slopes; read back on every SYNC if the drive has it."""
    settings: tuple[Setting, ...] = ()
    display: Index | None = None
    """Object with the present mode of operation; it must become ``requires_mode``."""


class Profile(_Part):
    """Description of a kind of drive."""

    name: str
    eds: str | None = None
    """EDS in the folder of the profile, unless ``driver.eds`` names another."""
    vendor_id: int | None = None
    """Vendor-ID (0x1018:1) that the drive must have; null: any."""
    controlword: Index = 0x6040
    statusword: Index = 0x6041
    position: Index
    actual: Quantity
    inputs: Index = 0x60FD
    """Digital inputs, 32 bits; ``driver.enable_bit`` is one of them."""
    supported_modes: Index = 0x6502
    modes: Annotated[tuple[Mode, ...], Field(min_length=1)]
    rated_current: Index | None = None
    """Object in mA."""
    rated_torque: Index | None = None
    """Object in 0.001 N m."""
    max_torque: Index | None = 0x6072
    """Object with the limit of the target, ‰ of the rated torque."""
    encoder_resolution: Index | None = 0x608F
    """Counts (sub 1) per revolutions (sub 2) of the encoder of ``position``; null: not the motor's encoder."""
    slopes: tuple[Setting, ...] = ()
    limits: tuple[LimitSetting, ...] = ()
    reactions: tuple[Setting, ...] = ()
    guarding: Literal["node_guarding", "heartbeat"] = "node_guarding"
    master_id: Annotated[int, Field(ge=1, le=127)] = 127
    """Node number under which this driver sends its heartbeat."""


def load_profile(name: str) -> tuple[Profile, Path | None]:
    """The profile of that name or path, and the path of its EDS.

    Raises:
        DriverConfigError: there is no such file, or it is not a profile; with file, key and value.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.is_file():
        path = Path(os.path.expanduser(name))  # noqa: PTH111 - leaves a user that there is not as it is
        if not path.exists():
            shipped = ", ".join(sorted(found.stem for found in FOLDER.glob("*.yaml")))
            raise DriverConfigError(f"driver.profile = {name!r}: no such profile ({shipped}) and no such file")
    try:
        data, doubts = read_yaml(read_text(path, str(path)), str(path))
    except ConfigError as error:
        doubts = error.problems
    if doubts:
        raise DriverConfigError(f"driver.profile = {name!r}: {'; '.join(map(str, doubts))}")
    try:
        profile = Profile.model_validate(_tuples(data))
    except ValidationError as exception:
        problems = "; ".join(
            f"{'.'.join(str(part) for part in error['loc']) or 'the file'}: {error['msg']}{_given(error)}"
            for error in exception.errors()
        )
        raise DriverConfigError(f"{path}: not a drive profile: {problems}") from exception
    return profile, None if profile.eds is None else path.parent / profile.eds


def _tuples(data: Any) -> Any:
    """Lists as tuples, because strict checking accepts only tuples."""
    if isinstance(data, dict):
        return {key: _tuples(value) for key, value in data.items()}
    return tuple(_tuples(value) for value in data) if isinstance(data, list) else data


def _given(error: Any) -> str:
    value = error.get("input")
    if error["type"] == "missing" or isinstance(value, dict | tuple):
        return ""
    return f", not {shown(value)}" + (f" (0x{value:x})" if isinstance(value, int) and abs(value) < 1 << 64 else "")
