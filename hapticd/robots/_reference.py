"""How a map names a signal in a bag: ``elbow.effort``, ``/arm/joint_states:elbow.position``, ``/command:data[2]``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import reduce
from typing import Any

JOINT_STATE = "sensor_msgs/msg/JointState"
_FIELDS = ("position", "velocity", "effort")
_REFERENCE = re.compile(r"(?:(?P<topic>/[^:]*):)?(?P<rest>.+)")
_PLACE = re.compile(r"(?P<path>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\[(?P<index>\d+)\])?")


class AmbiguousJointError(ValueError):
    """One name for several joints of a message."""


@dataclass(frozen=True)
class Reference:
    """A signal.

    Attributes:
        text: as the map has it.
        topic: that it is on; None: the only one of JointState.
        rest: the joint and its field, or the place in any other message.
    """

    text: str
    topic: str | None
    rest: str

    @classmethod
    def of(cls, text: str) -> Reference:
        """Split what a map has."""
        found = _REFERENCE.fullmatch(text)
        assert found is not None, text
        return cls(text, found["topic"], found["rest"])

    def problem(self, kind: str) -> str | None:
        """What is wrong with it for a message of that type, in words."""
        if kind == JOINT_STATE:
            joint, _, field = self.rest.rpartition(".")
            return (
                None
                if joint and field in _FIELDS
                else f"a joint of a JointState has {', '.join(_FIELDS)}: elbow.effort"
            )
        return (
            None if _PLACE.fullmatch(self.rest) else "a place in a message is written data, data[2] or wrench.force.x"
        )

    def value(self, message: Any, kind: str) -> float | None:
        """Its finite number in a message; None where the message has no such joint, or no number for every joint.

        Raises:
            AmbiguousJointError: the message has the joint twice.
        """
        if kind == JOINT_STATE:
            joint, _, field = self.rest.rpartition(".")
            names, values = list(message.name), getattr(message, field)
            if (times := names.count(joint)) > 1:
                raise AmbiguousJointError(
                    f"{self.text}: a message has the joint {joint} {times} times: which one is meant?"
                )
            return _finite(values[names.index(joint)]) if times and len(values) == len(names) else None
        place = _PLACE.fullmatch(self.rest)
        assert place is not None  # `problem` was asked
        try:
            found = reduce(getattr, place["path"].split("."), message)
            return _finite(found[int(place["index"])] if place["index"] else found)
        except (AttributeError, IndexError, TypeError, ValueError):
            return None


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
