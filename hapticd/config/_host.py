"""The sections of a configuration that describe this host: driver, recorder and control API."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ConfigDict, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from hapticd.config.fields import Flag, Section, Text, WholeLimit, findings_error, quantity
from hapticd.config.nearest import nearest_name
from hapticd.config.paths import default_directory, default_socket
from hapticd.config.problems import NO_VALUE, Finding


def _number_as_text(value: Any) -> Any:
    """A subject may be called 7; 07 is already text in `hapticd.config.reading`."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Label = Annotated[
    Annotated[Text, StringConstraints(min_length=1, max_length=200)] | None, BeforeValidator(_number_as_text)
]
_SOCKET_BYTES = 107  # sun_path of Linux is 108 bytes with its terminating zero


class Driver(Section):
    """The driver of encoder and amplifier; a driver's own options are next to its name."""

    model_config = ConfigDict(extra="allow")

    name: Text = quantity("loopback", "Driver: loopback or one listed by `hapticd drivers`")
    reconnect: Flag = quantity(
        False,
        "true: a device that was lost (fault driver_lost) is opened again as soon as it answers; the fault stays latched "
        "until it is cleared",
    )

    @model_validator(mode="before")
    @classmethod
    def _options_belong_to_a_name(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            findings = list(_driver_findings(data))
            if findings:
                raise findings_error(findings)
        return data

    @property
    def options(self) -> dict[str, Any]:
        """The driver's own options, as plain data that the caller may change."""
        return copy.deepcopy(self.__pydantic_extra__ or {})


def _driver_findings(data: Mapping[Any, Any]) -> Iterator[Finding]:
    options = [key for key in data if key not in Driver.model_fields]
    if options and "name" not in data:
        for key in options:
            if nearest_name(str(key), ["name"]):
                yield Finding(str(key), NO_VALUE, "unknown key; did you mean driver.name?", nearest="driver.name")
                return
        yield Finding("name", NO_VALUE, "is missing: name the driver that these options are for")
    if data.get("name") == "":
        yield Finding("name", "", "must name a driver, such as loopback")
    for key, value in data.items():
        yield from _option_findings(str(key), value)


def _option_findings(key: str, value: Any) -> Iterator[Finding]:
    """Options must be plain data, so that every configuration can be written, sent and hashed."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _option_findings(f"{key}.{name}", item)
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from _option_findings(f"{key}[{index}]", item)
    elif isinstance(value, float) and not math.isfinite(value):
        yield Finding(key, value, "must be finite")
    elif not isinstance(value, str | int | float | None):
        yield Finding(key, value, "must be plain data: text, numbers, true or false, lists and mappings")


def _default_if_null(default: Callable[[], str]) -> BeforeValidator:
    return BeforeValidator(lambda value: default() if value is None else value)


def _path(value: str) -> str:
    if not value or "\0" in value:
        raise PydanticCustomError("message", "must be a path")
    try:
        return str(Path(value).expanduser())
    except RuntimeError:
        raise PydanticCustomError("message", "no such user's home directory") from None


def _socket_path(value: str) -> str:
    path = _path(value)
    size = len(path.encode(errors="surrogateescape"))
    if size > _SOCKET_BYTES:
        raise PydanticCustomError(
            "message",
            "is {size} bytes long; a socket's path has at most {limit}",
            {"size": size, "limit": _SOCKET_BYTES},
        )
    return path


def _mode(value: Any) -> str:
    digits = value.removeprefix("0") if isinstance(value, str) else ""
    if len(digits) != 3 or not set(digits) <= set("01234567"):
        raise PydanticCustomError("message", 'must be octal permissions in quotes, such as "0660"')
    return f"0{digits}"


class Record(Section):
    """Recording of runs."""

    directory: Annotated[Text, _default_if_null(default_directory), AfterValidator(_path)] = quantity(
        default_directory,
        "Folder of the run files; null: $STATE_DIRECTORY/runs in a service, else $XDG_STATE_HOME/hapticd/runs",
    )
    flight_directory: Annotated[Text, AfterValidator(_path)] | None = quantity(
        None,
        "Folder of the flight recorder, which survives a crash; null: in memory ($RUNTIME_DIRECTORY, $XDG_RUNTIME_DIR, "
        "/dev/shm). On a disk it may survive a power cut, but the servo thread may wait for the disk",
    )
    enabled: Flag = quantity(
        True, "Record every run from start to stop; false: only on request (`hapticd record start`), and on a fault"
    )
    keep: WholeLimit = quantity(
        None,
        "Largest total size of the run files in the directory; beyond it the oldest are removed, except one that is being "
        "recorded, or is of a fault in the last day",
        "bytes",
        zero="all are kept",
        ge=0,
        le=10**15,
    )
    subject: Label = quantity(None, "Subject of the next recordings: stored in each, and a filter of `hapticd runs`")
    condition: Label = quantity(None, "Condition of the experiment; likewise")


class Api(Section):
    """The control API on a Unix socket."""

    socket: Annotated[Text, _default_if_null(default_socket), AfterValidator(_socket_path)] = quantity(
        default_socket,
        "Path of the socket; null: $XDG_RUNTIME_DIR/hapticd.sock, else /run/hapticd/hapticd.sock where that can be "
        "written, else /tmp/hapticd-$UID/hapticd.sock",
    )
    mode: Annotated[str, BeforeValidator(_mode)] = quantity("0660", "Permissions of the socket, octal, in quotes")
    group: Text | None = quantity(None, "Group that owns the socket and may command the motor; null: the daemon's own")
    watch_group: Text | None = quantity(
        None,
        "Group that may only read: status, config, metrics, stream; null: whoever may write to the socket has control. "
        "If it is set, the daemon checks each caller's groups, and mode is 0666",
    )
