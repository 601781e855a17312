"""Every endpoint of the control API, declared once: a method's signature is the body, its docstring the help.

From it `hapticd.service.api` creates routes and checks, `hapticd.client` its methods, `hapticd.cli` the help of commands,
and ``make docs`` creates ``docs/reference/openapi.json``. The daemon overrides every method (`hapticd.service.daemon`).

Standard library only, so that ``hapticd --help`` is quick: pydantic is imported when a body is checked.
"""

import functools
import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, ParamSpec, TypeVar, cast

from annotated_types import Ge, Le, Len

from hapticd.control._fields import (
    LONGEST_NOTE,
    STEPS,
    Force,
    PathText,
    Positive,
    Rule,
    Seconds,
    Setting,
    absolute,
    release_steps,
)

JsonDict = dict[str, Any]
Queue = Literal["query", "command", "note", "stop", "estop"]
P = ParamSpec("P")
R = TypeVar("R")

TEXT: Final = "text"
"""Reply of an endpoint that answers with plain text."""
_ERRORS: Final[dict[Queue, tuple[int, ...]]] = {
    "query": (),
    "command": (400, 403, 409, 413, 422),
    "note": (400, 403, 409, 413, 422),
    "stop": (403, 502),
    "estop": (403, 502),
}
_MARK: Final = "__endpoint__"

MOTION_S: Final = 2.0
"""Time within which a motion command must begin, else it is withdrawn [s]."""
PREPARED_MOTION_S: Final = 10.0
"""The same for a command that first waits until the shaft is at rest [s]."""


@dataclass(frozen=True)
class Endpoint:
    """One path of the API.

    Attributes:
        name: of the method here, in the daemon and in the client.
        method: of HTTP. path: of HTTP.
        reply: name of its model in `hapticd.control.schemas`, `TEXT`, or None for a dict without a model.
        queue: threads that answer it: some for queries, one for commands, one for notes, so that a note does not wait for a
            release. A stop and an estop are executed and answered when they arrive; they use no queue.
        errors: possible HTTP codes besides 200.
        motion_s: for a command that starts a motion, changes what is rendered or clears a fault: the time within which it
            must begin, s; its method also takes ``command`` (`hapticd.servo.authority.Command`), which a stop revokes. Else
        None. asks_trust: whether the daemon's method also takes ``trusted``: the caller is the daemon's own user or root,
            according to the kernel; it is not a field of the body.
        signature: of the method, without ``self``: the fields of the body.
        description: the docstring before ``Args``.
    """

    name: str
    method: Literal["GET", "POST"]
    path: str
    reply: str | None
    queue: Queue
    errors: tuple[int, ...]
    motion_s: float | None
    asks_trust: bool
    signature: inspect.Signature
    description: str

    @property
    def reads_body(self) -> bool:
        """Whether the body is read. A stop's body is not, so that a stop is never refused because of it."""
        return self.queue in ("command", "note")

    def help_of(self, parameter: str) -> str:
        """Meaning of a parameter: the text in its annotation."""
        metadata = self.signature.parameters[parameter].annotation.__metadata__
        return next(text for text in metadata if isinstance(text, str))


def endpoint(
    method: Literal["GET", "POST"],
    path: str,
    reply: str | None = None,
    *,
    queue: Queue | None = None,
    device: bool = False,
    motion_s: float | None = None,
    asks_trust: bool = False,
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare the endpoint whose name, body and help are the method's name, signature and docstring.

    Args:
        method, path: of HTTP.
        reply: see `Endpoint`.
        queue: see `Endpoint`; by default that of queries for GET, that of commands for POST.
        device: whether it accesses the device, which may fail.
        motion_s, asks_trust: see `Endpoint`.
    """

    def declare(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function, eval_str=True)
        fields = signature.replace(parameters=list(signature.parameters.values())[1:])
        executor: Queue = queue or ("query" if method == "GET" else "command")
        errors = _ERRORS[executor]
        text = re.split(r"\n\n(?:Args|Returns|Raises):", inspect.cleandoc(function.__doc__ or ""))[0]
        declared = Endpoint(
            function.__name__,
            method,
            path,
            reply,
            executor,
            errors + ((502,) if device else ()),
            motion_s,
            asks_trust,
            fields,
            text,
        )

        @functools.wraps(function)
        def call(self: Any, *arguments: Any, **keywords: Any) -> Any:
            given = fields.bind(*arguments, **keywords).arguments
            changed = {name: value for name, value in given.items() if value != fields.parameters[name].default}
            return self.send(declared, changed)

        setattr(call, _MARK, declared)
        return cast(Callable[P, R], call)

    return declare


def endpoint_of(method: Callable[..., Any]) -> Endpoint:
    """The declaration of a method of :class:`Endpoints`."""
    found: Endpoint = getattr(method, _MARK)
    return found


def declared(owner: type) -> list[Endpoint]:
    """The endpoints of a class, in the order of its source."""
    return [endpoint_of(value) for value in vars(owner).values() if hasattr(value, _MARK)]


class Endpoints:
    """All requests to the daemon. Every method may be called from any thread, and returns data for JSON.

    A subclass either overrides all methods (the daemon) or has ``send(endpoint, fields)``, which every method calls with
    the arguments that differ from the default (the client).
    """

    @endpoint("GET", "/status", "Status")
    def status(self) -> JsonDict:
        """Show the state of the daemon: fault, timing, operating point, position, recording, experiment.

        Position is counted from the spring's origin, in rad or m and in coarse ticks; velocity (an estimate) is in rad/s or
        m/s, current in A.
        """

    @endpoint("GET", "/config")
    def config(self) -> JsonDict:
        """Show the present config, section by section."""

    @endpoint("GET", "/metrics", TEXT)
    def metrics(self) -> str:
        """Show the daemon's metrics in Prometheus' text format."""

    @endpoint("GET", "/experiment", "Experiment")
    def experiment(self) -> JsonDict:
        """Show the newest experiment and its progress.

        If a fault ended it, the result has the fault's code as ``fault``.
        """

    @endpoint("POST", "/start", "JudgedStatus", device=True, motion_s=MOTION_S)
    def start(self, force: Force = False) -> JsonDict:
        """Enable the amplifier and render the spring.

        Refused while a fault is latched: see 'hapticd status', repair the cause, then 'hapticd clear'. Also refused, with
        remedies, if in theory the motion from the shaft's position would not die out (safety.guard).

        Raises:
            Refused: code ``fault``, ``busy`` or ``unstable``.
            DriverFailure: the device cannot be enabled.
        """

    @endpoint("POST", "/stop", "Status", queue="stop")
    def stop(self) -> JsonDict:
        """Zero current, then disable the amplifier.

        Ends a running experiment. The servo loop keeps running and can be started again.
        """

    @endpoint("POST", "/estop", "Status", queue="estop")
    def estop(self) -> JsonDict:
        """Zero current at once, disable the amplifier and latch a fault.

        This is a software stop, not a safety-rated one. 'hapticd clear' releases it.
        """

    @endpoint("POST", "/clear", "Status", device=True, motion_s=MOTION_S)
    def clear(self) -> JsonDict:
        """Clear a latched fault.

        A fault stays latched, also over a restart of the daemon, until it is cleared here. A fault that was raised after the
        command arrived is not cleared: nobody has seen it yet.

        Raises:
            Refused: its cause still exists, or it is a later fault.
        """

    @endpoint("POST", "/set", "SetReply", motion_s=MOTION_S)
    def set(
        self,
        settings: Annotated[
            dict[str, Setting],
            Len(1, 200),
            "Dotted key to value, as {'servo.rate_hz': 500, 'encoder.decimation': 217}; text is read as a YAML scalar.",
        ],
        force: Force = False,
    ) -> JsonDict:
        """Change settings while the daemon runs: all of them between the same two ticks, or none.

        Live are servo.rate_hz (Hz), servo.overrun.*, spring.* (stiffness in N m/rad or N/m, origin in rad or m),
        encoder.decimation, dither.* (amplitude in coarse ticks or A, frequency_hz), delay.* (s), safety.*, record.subject,
        and record.condition; every other key needs a restart. Changes are not written to the config file.

        Settings with which in theory no motion dies out are refused, with remedies (safety.guard); then nothing changes.

        Raises:
            ConfigError: unknown key or bad value.
            Refused: code ``restart_needed`` or ``unstable``.
        """

    @endpoint("POST", "/origin", "SetReply", motion_s=MOTION_S)
    def origin(self, force: Force = False) -> JsonDict:
        """Move the spring's origin to the shaft's position, where no force acts on it.

        Use it after a runaway, or after a device was opened again. It is 'set spring.origin' with the position of the last
        tick.

        Raises:
            Refused: code ``busy`` or ``unstable``.
        """

    @endpoint("POST", "/reload", "JudgedStatus", device=True, motion_s=PREPARED_MOTION_S, asks_trust=True)
    def reload(
        self,
        path: Annotated[
            PathText | None, "Absolute path or preset name. Default: the file that the daemon was started with."
        ] = None,
        force: Force = False,
    ) -> JsonDict:
        """Read the config again and apply it.

        An invalid config is refused, and the present one stays; so is one with which in theory no motion dies out. Only the
        daemon's own user and root may name another file than that of the start; others may name a preset.

        Raises:
            ConfigError: the config is wrong.
            Refused: code ``restart_needed``, ``unstable`` or ``outside``.
        """

    @endpoint("POST", "/release", "ReleaseReply", device=True, motion_s=PREPARED_MOTION_S)
    def release(
        self,
        deflection: Annotated[float, Ge(-1e9), Le(1e9), "Deflection at rest, in coarse ticks."],
        duration_s: Annotated[Seconds | None, "Recorded time in s. Default: enough."] = None,
        force: Force = False,
    ) -> JsonDict:
        """Release the shaft from rest at a deflection, and record what follows (the paper's Fig. 8).

        The spring's origin is moved, so that the shaft is at that deflection without moving; the result has the achieved
        deflection, exact to one raw encoder count.

        Refused if in theory this motion would not die out (safety.guard): case d of Fig. 8 needs --force.

        Raises:
            Refused: not in a state that allows it, or another experiment is running.
        """

    @endpoint("POST", "/excite", "JobReply", device=True, motion_s=PREPARED_MOTION_S)
    def excite(
        self,
        name: Annotated[str, "Which experiment."] = "all",
        *,
        amplitude: Annotated[
            Positive | None,
            "Peak: A for current shapes, rad or m for those that move the spring's origin. Default: a safe one.",
        ] = None,
        duration_s: Annotated[Seconds | None, "Recorded time in s. Default: enough."] = None,
        low_hz: Annotated[Positive | None, "Where a chirp begins, Hz. Default: the daemon chooses."] = None,
        high_hz: Annotated[Positive | None, "Where a chirp ends, Hz. Default: the daemon chooses."] = None,
        seed: Annotated[
            Annotated[int, Ge(0), Le(2**53)] | None, "Seed of what is random in a shape. Default: 1."
        ] = None,
        force: Force = False,
    ) -> JsonDict:
        """Run an identification experiment within the safety limits, and record it.

        The recording is what 'hapticd gap' compares with the simulation.

        Raises:
            ExcitationError: unknown name, or beyond a limit of the config.
            Refused: not in a state that allows it, or another experiment is running.
        """

    @endpoint("POST", "/sequence", "SequenceReply", device=True, motion_s=PREPARED_MOTION_S)
    def sequence(
        self,
        steps: Annotated[
            list[dict[str, Any]],
            Len(1, 500),
            Rule(release_steps, STEPS),
            "Releases in order, each an object: deflection (coarse ticks of its own settings), settings (dotted live keys; "
            "default none) and duration_s (default: enough).",
        ],
        name: Annotated[str, Len(1, 200), "Of the experiment; in every run of it."] = "sequence",
        force: Force = False,
    ) -> JsonDict:
        """Release the shaft once under each of a list of settings, as one experiment.

        Each step changes some settings; the previous ones are restored at the end. All steps are judged before the first
        one begins; each waits until the shaft is at rest, and has its own run file. A stop, a fault or a shaft that does not
        come to rest ends the whole sequence.

        Raises:
            ConfigError: a setting is wrong.
            Refused: not in a state that allows it, another experiment is running, or theory refuses a step.
        """

    @endpoint("POST", "/record/start", "RecorderStatus", asks_trust=True)
    def record_start(
        self,
        path: Annotated[
            PathText | None, Rule(absolute), "Absolute path of a new run file. Default: a new one in record.directory."
        ] = None,
    ) -> JsonDict:
        """Start recording every tick.

        The file is an Arrow IPC stream with the config, versions and host facts in its metadata. An existing file is
        refused; so is one outside record.directory, unless the caller is the user of a daemon that is no service.

        Raises:
            Refused: already recording, the file exists, or (code ``outside``) it is outside ``record.directory``.
        """

    @endpoint("POST", "/record/stop", "RecorderStatus")
    def record_stop(self) -> JsonDict:
        """Stop recording and close the file.

        Raises:
            Refused: nothing is being recorded.
        """

    @endpoint("POST", "/note", "Noted", queue="note")
    def note(self, text: Annotated[str, Len(1, LONGEST_NOTE), "What to note."]) -> JsonDict:
        """Add a note to the running recording, with the present tick.

        Raises:
            Refused: code ``recording``, nothing is being recorded.
        """

    @endpoint("POST", "/marker", "Noted", queue="note")
    def marker(
        self,
        name: Annotated[str, Len(1, 200), "Of what happened, such as stimulus_onset."],
        value: Annotated[Setting, "A number or text that belongs to it."] = None,
    ) -> JsonDict:
        """Mark the present tick in the running recording, for events of an experiment's own software.

        It does not wait for other commands, not even for a release that is being prepared.

        Raises:
            Refused: code ``recording``, nothing is being recorded.
        """
