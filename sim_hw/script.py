"""The script of a simulated device: an operator's hand, the initial state, and the faults.

A YAML file with the optional sections ``hand``, ``start`` and ``faults``; every key is described in
``docs/reference/simulated-hardware.md``. The reader reports all problems at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import ConfigError, Problem
from hapticd.config.nearest import nearest_name
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown
from sim_hw import kinds

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SECTIONS = ("hand", "start", "faults")
_BENCH = ("position", "counts_offset", "current_gain")
_ANY = (*_BENCH, "watchdog")
_START = {"serial": _ANY, "canopen": (*_ANY, "missing", "override"), "firmware": _BENCH}
"""What a script may say of a device's start; a binary has the watchdog that it has."""
_FIRST_OBJECT, _LAST_OBJECT = 0x1000, 0xFFFF


@dataclass(frozen=True)
class Script:
    """The content of a script.

    Attributes:
        hand_from: origin of the hand's instants, 0: the device's start, 1: the first enable.
        hand_ns: (n,) int64, instants of the hand's steps, ns, ascending.
        hand_force: (n,) torque or force from then on, N m or N.
        position: true initial position, rad or m.
        counts_offset: count at position 0.
        current_gain: motor current over command. watchdog: 0: it does not work.
        faults: (m, FAULT_WORDS) int64, see :mod:`sim_hw.layout`.
        wrong_version: a wrong protocol version that the device reports, or None; with any number a CANopen
            drive reports another device type and vendor.
        missing: indexes of objects that a CANopen drive does not have.
        override: other power-up values, by (index, sub-index).
    """

    hand_from: int = 0
    hand_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    hand_force: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    position: float = 0.0
    counts_offset: int = 0
    current_gain: float = 1.0
    watchdog: int = 1
    faults: NDArray[np.int64] = field(default_factory=lambda: kinds.fault_table([]))
    wrong_version: int | None = None
    missing: tuple[int, ...] = ()
    override: Mapping[tuple[int, int], int] = field(default_factory=dict)


def load_script(path: str | Path | None, device: str) -> Script:
    """Read a script.

    Args:
        path: the YAML file; None for an empty script.
        device: ``serial``, ``canopen`` or ``firmware`` (a serial board, too); a fault of another device is an error.

    Raises:
        ConfigError: with all problems: unknown section, key or kind (and the nearest valid one), missing key,
            value out of range.
    """
    if path is None:
        return Script()
    name = str(path)
    data, problems = read_yaml(read_text(Path(path), name), name)
    if data is None and not problems:
        raise ConfigError([Problem(name, "", None, "is empty; write {} for a script without events")])
    return _Reader(name, device, problems).script(data)


class _Reader:
    """Reads a script and collects problems; a wrong value is replaced by a valid one, to check the rest."""

    def __init__(self, name: str, device: str, problems: list[Problem]) -> None:
        self._name, self._start, self._problems = name, _START[device], problems
        self._device = "serial" if device == "firmware" else device

    def script(self, data: object) -> Script:
        sections = self._mapping(data, "", _SECTIONS)
        hand = [self._hand(step, f"hand[{n}]") for n, step in enumerate(self._list(sections.get("hand"), "hand"))]
        start = self._mapping(sections.get("start", {}), "start", self._start)
        position, offset, gain, watchdog = (self._number(start, "start", name) for name in _ANY)
        missing = [
            self._object(name, f"start.missing[{n}]")[0]
            for n, name in enumerate(self._list(start.get("missing"), "start.missing"))
        ]
        override = self._override(start.get("override", {}))
        faults = [
            self._fault(fault, f"faults[{n}]") for n, fault in enumerate(self._list(sections.get("faults"), "faults"))
        ]
        origins = {origin for _, _, origin in hand}
        if len(origins) > 1:
            self._add("hand", None, "has steps from start and steps from enabled; all must have the same origin")
        if any(after[0] < before[0] for before, after in pairwise(hand)):
            self._add("hand", None, "has steps that are not in the order of their at_s")
        if self._problems:
            raise ConfigError(self._problems)
        versions = [fault["version"] for fault in faults if fault["kind"] == "wrong_version"]
        return Script(
            hand_from=origins.pop() if origins else 0,
            hand_ns=np.array([kinds.to_ns(at_s) for at_s, _, _ in hand], np.int64),
            hand_force=np.array([force for _, force, _ in hand], np.float64),
            position=float(position),
            counts_offset=offset,
            current_gain=float(gain),
            watchdog=watchdog,
            faults=kinds.fault_table(fault for fault in faults if fault["kind"] != "wrong_version"),
            wrong_version=versions[-1] if versions else None,
            missing=tuple(missing),
            override=override,
        )

    def _object(self, name: object, key: str) -> tuple[int, int]:
        """``0x6076`` or ``"0x1018:1"`` as (index, sub-index)."""
        index, _, subindex = (hex(name) if isinstance(name, int) else str(name)).partition(":")
        try:
            place = int(index, 0), int(subindex or "0")
        except ValueError:
            place = 0, 0
        if not (_FIRST_OBJECT <= place[0] <= _LAST_OBJECT and 0 <= place[1] <= 0xFF):
            self._add(key, name, 'must be an object of the dictionary, such as 0x6076 or "0x1018:1"')
        return place

    def _override(self, data: object) -> dict[tuple[int, int], int]:
        if not isinstance(data, Mapping):
            self._add("start.override", data, "must map objects to values, such as {0x6076: 0}")
            return {}
        limit = kinds.NUMBERS["override"]
        return {
            self._object(name, "start.override"): self._number(data, "start.override", name, limit) for name in data
        }

    def _hand(self, data: object, key: str) -> tuple[float, float, int]:
        step = self._mapping(data, key, ("at_s", "force", "from"), required=("at_s", "force"))
        at_s, force = (self._number(step, key, name) for name in ("at_s", "force"))
        return at_s, force, self._choice(step, key, "from", kinds.ORIGINS, "start")

    def _fault(self, data: object, key: str) -> dict[str, Any]:
        given = data.get("kind") if isinstance(data, Mapping) else None
        if not isinstance(data, Mapping) or given is None:
            self._add(key, data, "must be a mapping with a kind, such as {kind: silent, at_s: 1.0}")
            return {"kind": ""}
        kind = kinds.KINDS.get(str(given))
        if kind is None:
            self._unknown(f"{key}.kind", given, kinds.KINDS, "is not a kind of fault")
            return {"kind": ""}
        if self._device not in kind.devices:
            self._add(f"{key}.kind", given, f"is a fault of {kind.devices[0]} devices; this one is {self._device}")
            return {"kind": ""}
        fault = self._mapping(data, key, ("kind", *kind.keys), required=kind.required)
        return {"kind": str(given), **{name: self._fault_value(fault, key, name) for name in kind.keys}}

    def _fault_value(self, fault: Mapping[str, Any], key: str, name: str) -> Any:
        if name == "from":
            return self._choice(fault, key, name, kinds.FAULT_ORIGINS, "start")
        if name == "frames":
            return self._choice(fault, key, name, kinds.FRAMES[self._device], "any")
        if name == "object":
            return self._object(fault[name], f"{key}.{name}") if name in fault else (0, 0)
        return self._number(fault, key, name)

    def _add(self, key: str, value: object, message: str, nearest: str | None = None) -> None:
        text = None if value is None else shown(value)
        self._problems.append(Problem(self._name, key, text, message, nearest=nearest))

    def _unknown(self, key: str, value: object, valid: Iterable[str], what: str) -> None:
        names = sorted(valid)
        nearest = nearest_name(str(value), names)
        hint = f"did you mean {nearest}?" if nearest else "known: " + ", ".join(names)
        self._add(key, value, f"{what}; {hint}", nearest)

    def _mapping(
        self, data: object, key: str, valid: tuple[str, ...], required: tuple[str, ...] = ()
    ) -> Mapping[str, Any]:
        if not isinstance(data, Mapping):
            self._add(key, data, "must be a mapping with the keys " + ", ".join(valid))
            return {}
        for name in data:
            if name not in valid:
                nearest = nearest_name(str(name), valid)
                hint = f"did you mean {nearest}?" if nearest else "keys: " + ", ".join(valid)
                where = f"{key}.{name}" if key else str(name)
                self._problems.append(Problem(self._name, where, None, f"unknown key; {hint}", nearest=nearest))
        for name in required:
            if name not in data:
                self._problems.append(Problem(self._name, f"{key}.{name}", None, "is missing"))
        return data

    def _list(self, data: object, key: str) -> list[Any]:
        if data is None:
            return []
        if not isinstance(data, list):
            self._add(key, data, "must be a list")
            return []
        return data

    def _choice(self, data: Mapping[str, Any], key: str, name: str, valid: Mapping[str, int], default: str) -> int:
        value = data.get(name, default)
        if str(value) not in valid:
            self._unknown(f"{key}.{name}", value, valid, "is not allowed")
        return valid.get(str(value), valid[default])

    def _number(self, data: Mapping[str, Any], key: str, name: str, limit: kinds.Limit | None = None) -> Any:
        """A value within a limit, by default that of its name; the limit's default if it is missing or wrong."""
        limit = limit or kinds.NUMBERS[name]
        value = data.get(name, limit.default)
        if name == "duration_s" and value == "forever":
            return math.inf
        if isinstance(value, bool) or not isinstance(value, int if limit.whole else int | float) or value != value:
            self._add(f"{key}.{name}", value, "must be a whole number" if limit.whole else "must be a number")
        elif not limit.least <= value <= limit.most or (math.isinf(value) and name != "duration_s"):
            form = "" if limit.whole else "g"
            limits = f"between {limit.least:{form}} and {limit.most:{form}}"
            unit = " s" if name.endswith("_s") else ""
            self._add(f"{key}.{name}", value, f"must be {'finite' if math.isinf(limit.most) else limits}{unit}")
        else:
            return value
        return limit.default
