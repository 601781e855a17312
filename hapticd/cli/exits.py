"""Exit codes, and which error ends in which: the one place where an exception becomes words and a number.

An exception can only arrive here when the module that defines it has been imported, so nothing is imported to tell.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import asdict, dataclass, field
from typing import Any, Final

DONE: Final = 0
NO: Final = 1
USAGE: Final = 2
UNREACHABLE: Final = 3
DEVICE: Final = 4
FAULT: Final = 5
INTERRUPTED: Final = 130
BROKEN_PIPE: Final = 141
"""128 + SIGPIPE, what a shell reports for any program whose reader went away."""

MEANING: Final[dict[int, str]] = {
    DONE: "done",
    NO: "done, and the answer is no",
    USAGE: "usage or config error",
    UNREACHABLE: "daemon not reachable",
    DEVICE: "device or driver failure",
    FAULT: "the daemon stopped on a fault",
    INTERRUPTED: "interrupted",
}


options: ContextVar[frozenset[str]] = ContextVar("options", default=frozenset())
"""What the command at hand can be given, without the dashes."""


@dataclass(frozen=True)
class Failure:
    """An error as the user meets it."""

    exit_code: int
    code: str
    message: str
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def document(self) -> dict[str, Any]:
        """The JSON form, the same as the control API's."""
        return {"error": {"code": self.code, "message": self.message, **self.more}}


class UsageError(Exception):
    """The command line asks for something that cannot be meant; the text says what would be right."""


def explain(error: Exception) -> Failure | None:
    """What to tell the user about an error, or None for one that nobody foresaw."""
    if isinstance(error, UsageError):
        return Failure(USAGE, "usage", str(error))
    for module, name, make in _KNOWN:
        kind = getattr(sys.modules.get(module), name, None)
        if kind is not None and isinstance(error, kind):
            return make(error)
    if isinstance(error, RuntimeError) and str(error) == "can't start new thread":
        return Failure(DEVICE, "threads", "the system gives no further thread: raise its limit (TasksMax, ulimit -u)")
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return Failure(USAGE, "file", f"{where}{error.strerror or error}")
    return None


def _refused(error: Any) -> Failure:
    if error.status == 502:
        exit_code = DEVICE
    elif error.status in (400, 404, 405, 413, 422):
        exit_code = USAGE
    else:
        exit_code = NO
    more = {"problems": error.problems} if error.problems else {}
    return Failure(exit_code, error.code, _words(error), {**more, **error.choice})


def _words(error: Any) -> str:
    """The message; of a refusal that leaves a choice, with the options of the command at hand."""
    if not error.choice.get("force"):
        return str(error)
    from hapticd.control.refusal_text import refusal_text

    return refusal_text(error.choice, lambda name: f"--{name}" if name in options.get() else None)


def _config(error: Any) -> Failure:
    return Failure(USAGE, "config", str(error), {"problems": [asdict(problem) for problem in error.problems]})


def _plain(exit_code: int, code: str) -> Callable[[Any], Failure]:
    return lambda error: Failure(exit_code, code, str(error))


_KNOWN: Final[tuple[tuple[str, str, Callable[[Any], Failure]], ...]] = (
    ("hapticd.client", "RequestRefused", _refused),
    ("hapticd.client", "DaemonUnreachable", _plain(UNREACHABLE, "unreachable")),
    ("hapticd.config", "ConfigError", _config),
    ("hapticd.config.units", "UnitError", _plain(USAGE, "usage")),
    ("hapticd.service.socket", "SocketError", _plain(USAGE, "socket")),
    ("hapticd.service.refusals", "DriverFailure", _plain(DEVICE, "driver")),
    ("hapticd.service.refusals", "Refused", lambda error: Failure(NO, error.code, _words(error), error.choice)),
    ("drivers", "DriverConfigError", _plain(USAGE, "config")),
    ("drivers", "DriverError", _plain(DEVICE, "driver")),
    ("hapticd.servo.realtime", "RealtimeError", _plain(DEVICE, "realtime")),
    ("hapticd.hil.errors", "HilError", _plain(DEVICE, "hil")),
    ("hapticd.gap.errors", "RecordingError", _plain(USAGE, "recording")),
    ("hapticd.record.errors", "RecordingError", _plain(USAGE, "file")),
    ("hapticd.record.errors", "RunFileError", _plain(USAGE, "file")),
    ("hapticd.export.errors", "ExportError", _plain(USAGE, "export")),
    ("hapticd.gap.live", "LiveError", _plain(FAULT, "live")),
)
