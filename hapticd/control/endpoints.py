"""Every endpoint of the control API, declared once: a method's signature is the body, its docstring the help.

`hapticd.service.api` makes the routes and their checks from it, `hapticd.client` its methods, `hapticd.cli` the help of the
commands, and ``docs/reference/openapi.json`` follows. The daemon overrides every method (`hapticd.service.daemon`).

Plain standard library, so that ``hapticd --help`` stays quick: pydantic is imported when a body is checked.
"""

import functools
import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, ParamSpec, TypeVar, cast

from annotated_types import Ge, Le, Len

from hapticd.control.fields import (
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
"""Time within which a command that sets the motor in motion has to begin, s; later it does not begin at all."""
PREPARED_MOTION_S: Final = 10.0
"""The same for one that first waits until the shaft is at rest, s."""


@dataclass(frozen=True)
class Endpoint:
    """One path of the API.

    Attributes:
        name: of the method, here, of the daemon and of the client.
        method: of HTTP. path: of HTTP.
        reply: name of its model in `hapticd.control.schemas`, `TEXT`, or None for a dict without a model.
        queue: who answers it: threads for queries, one thread for commands, one for notes, so that what is to be noted now
            waits for no release. A stop and an estop are carried out when they
            arrive and answered where they arrive; they are in no queue.
        errors: HTTP codes that it may answer with, besides 200.
        motion_s: of a command that sets the motor in motion, changes what it renders or clears a fault, the time within
            which it has to begin, s; its method also takes ``command`` (`hapticd.servo.authority.Command`), which a stop
            revokes. None: of any other.
        asks_trust: whether the daemon's method also takes ``trusted``: the caller is the daemon's own user or root. The
            server says so, from what the kernel tells it; it is no field of the body.
        signature: of the method, without ``self``: the fields of the body.
        description: the docstring, without ``Args`` and what follows.
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
        """Whether a body is looked at. That of a stop never is: a stop is not refused for its form."""
        return self.queue in ("command", "note")

    def help_of(self, parameter: str) -> str:
        """What a parameter means: the text in its annotation."""
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
        device: it reaches the device, which may fail.
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
    """The declaration behind a method of :class:`Endpoints`."""
    found: Endpoint = getattr(method, _MARK)
    return found


def declared(owner: type) -> list[Endpoint]:
    """The endpoints of a class, in the order of its text."""
    return [endpoint_of(value) for value in vars(owner).values() if hasattr(value, _MARK)]


class Endpoints:
    """What the daemon can be asked. Every method may be called from any thread and returns what JSON can hold.

    A subclass either overrides them all (the daemon) or has ``send(endpoint, fields)``, which every method calls with the
    arguments that are not the default (the client).
    """

    @endpoint("GET", "/status", "Status")
    def status(self) -> JsonDict:
        """Show what the daemon is doing: state, fault, timing, operating point, position, recording, experiment.

        Position is counted from the spring's origin, in rad or m and in coarse ticks; velocity (an estimate) is in rad/s or
        m/s, current in A.
        """

    @endpoint("GET", "/config")
    def config(self) -> JsonDict:
        """Show the config in force, section by section."""

    @endpoint("GET", "/metrics", TEXT)
    def metrics(self) -> str:
        """Show the daemon's metrics in Prometheus' text format."""

    @endpoint("GET", "/experiment", "Experiment")
    def experiment(self) -> JsonDict:
        """Show the newest experiment and how far it is.

        The result of one that a fault ended carries the fault's code as ``fault``.
        """

    @endpoint("POST", "/start", "JudgedStatus", device=True, motion_s=MOTION_S)
    def start(self, force: Force = False) -> JsonDict:
        """Enable the amplifier and render the spring.

        Refused while a fault is latched: look at 'hapticd status', repair the cause, then 'hapticd clear'. Refused, too,
        where theory says that the motion from where the shaft stands would not die out, with what would help (safety.guard).

        Raises:
            Refused: code ``fault``, ``busy`` or ``unstable``.
            DriverFailure: the device cannot be enabled.
        """

    @endpoint("POST", "/stop", "Status", queue="stop")
    def stop(self) -> JsonDict:
        """Zero current, then disable the amplifier.

        Ends a running experiment. The daemon keeps ticking and can be started again.
        """

    @endpoint("POST", "/estop", "Status", queue="estop")
    def estop(self) -> JsonDict:
        """Zero current at once, disable the amplifier and latch a fault.

        This is a software stop, not a safety-rated one. 'hapticd clear' releases it.
        """

    @endpoint("POST", "/clear", "Status", device=True, motion_s=MOTION_S)
    def clear(self) -> JsonDict:
        """Clear a latched fault.

        A fault stays latched, also across a restart of the daemon, until it is cleared here. One that was raised after the
        command came is not cleared by it: nobody has seen it yet.

        Raises:
            Refused: its cause is still there, or it is a later fault.
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
        """Change settings while the daemon runs: all of them together between two ticks, or none.

        Live are servo.rate_hz (Hz), servo.overrun.*, spring.* (stiffness in N m/rad or N/m, origin in rad or m),
        encoder.decimation, dither.* (amplitude in coarse ticks or A, frequency_hz), delay.* (s), safety.*, record.subject,
        and record.condition; every other key needs a restart. Changes are not written to the config file.

        Settings with which theory sees no motion die out are refused, with what would help (safety.guard); nothing changes.

        Raises:
            ConfigError: unknown key or bad value.
            Refused: code ``restart_needed`` or ``unstable``.
        """

    @endpoint("POST", "/origin", "SetReply", motion_s=MOTION_S)
    def origin(self, force: Force = False) -> JsonDict:
        """Move the spring's origin to where the shaft is: no force acts on it there.

        What to do after a runaway, or once a device was opened again. It is 'set spring.origin' with the place of the last
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
        """Read the config anew and put it into force.

        A wrong config is refused and the one in force stays; so is one with which theory sees no motion die out. Another
        file than the one it was started with is for the daemon's own user and root; others may name a preset.

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

        The spring's origin is moved so that the shaft, where it stands, is at that deflection; the result reports the
        deflection really achieved, exact to one raw encoder count.

        Refused where theory says that this motion would not die out (safety.guard): case d of Fig. 8 takes --force.

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

        Each step's settings are beside what was in force before, which comes back at the end. All steps are judged before
        the first one begins; each waits until the shaft is at rest, and is a run file of its own. A stop, a fault or a shaft
        that does not come to rest ends the whole of it.

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
        """Note something in the running recording, with the tick at which it was said.

        Raises:
            Refused: code ``recording``, nothing is being recorded.
        """

    @endpoint("POST", "/marker", "Noted", queue="note")
    def marker(
        self,
        name: Annotated[str, Len(1, 200), "Of what happened, such as stimulus_onset."],
        value: Annotated[Setting, "A number or text that belongs to it."] = None,
    ) -> JsonDict:
        """Mark this tick in the running recording: what an experiment's own software sends when something happens.

        It waits for no other command, a release that is being prepared included.

        Raises:
            Refused: code ``recording``, nothing is being recorded.
        """
