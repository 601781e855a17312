"""Bodies and replies of the control API as pydantic models: what the OpenAPI document says, and what is enforced.

Requests are enforced strictly: unknown fields, numbers written as strings and non-finite numbers are rejected. Replies
are described here for the document and sent as the daemon made them.
"""

from __future__ import annotations

from functools import cache
from inspect import Parameter
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from hapticd.control.endpoints import TEXT, Endpoint


class Request(BaseModel):
    """Base of every request body."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


@cache
def body_of(endpoint: Endpoint) -> type[Request] | None:
    """The model of an endpoint's body, its fields being the parameters of the method; None where no body is looked at."""
    if not endpoint.reads_body:
        return None
    fields: dict[str, Any] = {
        name: (parameter.annotation, Field(_default(parameter), description=endpoint.help_of(name)))
        for name, parameter in endpoint.signature.parameters.items()
    }
    name = "".join(part.title() for part in endpoint.name.split("_")) + "Body"
    return create_model(name, __base__=Request, __doc__=f"Body of {endpoint.path}.", **fields)


def reply_of(endpoint: Endpoint) -> type[Reply] | None:
    """The model of an endpoint's reply; None where it has none."""
    return None if endpoint.reply in (None, TEXT) else globals()[str(endpoint.reply)]


def _default(parameter: Parameter) -> Any:
    return ... if parameter.default is Parameter.empty else parameter.default


class ErrorDetail(BaseModel):
    """Why a request was not carried out."""

    code: str = Field(
        description="Short stable name: request, json, too_large, config, excitation, unstable, driver, internal or another."
    )
    message: str = Field(description="A sentence for people, naming what, where, and what would be right.")
    problems: list[dict[str, Any]] | None = Field(
        None, description="For code config: file, key, value, message, limit, unit and nearest of each wrong setting."
    )
    reason: str | None = Field(None, description="The message without what to do about it, where there is such.")
    remedies: list[dict[str, Any]] | None = Field(
        None,
        description="Changes each of which is enough: key, before, after, unit, words, region_after, buzz_after, "
        "and, in a sequence, step.",
    )
    help: str | None = Field(None, description="What would help where no single change is enough.")
    force: bool | None = Field(None, description="Whether the same request with force would be carried out.")


class ErrorReply(BaseModel):
    """The body of every reply that is not 200."""

    error: ErrorDetail


class Reply(BaseModel):
    """Base of every reply; fields may be added in later versions."""

    model_config = ConfigDict(extra="allow")


class Fault(Reply):
    """A latched fault."""

    code: str = Field(description="Name of the fault, e.g. over_speed.")
    cause: str = Field(description="What happened, with the numbers that tripped it.")
    help: str = Field(description="The command that shows the page about this fault.")
    remedy: str = Field(description="What a person does about it.")
    time: str | None = Field(description="When it was latched, UTC, ISO 8601; null where that is not known.")
    config: str | None = Field(description="Name of the configuration under which it was latched.")
    config_digest: str | None = Field(description="Digest of that configuration.")
    not_latched: str | None = Field(description="Why it would not outlive a restart; null: it would.")
    from_before: bool = Field(description="Whether it was latched before the daemon began.")


class Percentiles(Reply):
    """Percentiles of a time, in microseconds."""

    p50: float | None
    p99: float | None
    p999: float | None
    max: float | None


class Pace(Reply):
    """How the servo loop did over some time."""

    ticks: int = Field(description="Ticks executed.")
    missed: int = Field(description="Periods skipped.")
    exchanges_missed: int = Field(description="Failed exchanges with the device.")
    wake_us: Percentiles = Field(description="How late the loop woke.")
    exec_us: Percentiles = Field(description="How long a tick took.")
    verdict: str = Field(description="Whether the loop kept up, in words.")


class RecentPace(Pace):
    """How the servo loop did lately; the maxima are right to 3 %."""

    span_s: float = Field(description="Time that this is about, s; less than its name says shortly after the start.")


class Timing(Pace):
    """Timing of the servo loop since its start."""

    rate_hz: float = Field(description="Configured rate in Hz.")
    last_10_s: RecentPace = Field(description="The same over the last 10 s.")
    last_60_s: RecentPace = Field(description="The same over the last 60 s.")


class OperatingPoint(Reply):
    """Dimensionless numbers of the paper's Table I, computed through the model."""

    mu: float | None
    beta: float | None
    sigma: float | None
    tau_d: float | None
    region: str | None


class Enable(Reply):
    """The enable input that a person holds."""

    required: bool = Field(description="Whether the motor moves only while it is held (safety.enable).")
    held: bool | None = Field(description="Whether it is held; null where the driver has none.")


class RecorderStatus(Reply):
    """The recorder."""

    path: str | None = Field(description="File being written, or the one just finished; null when there is none.")
    rows: int = Field(description="Rows written.")
    dropped: int = Field(description="Rows lost because the writer fell behind.")
    error: str | None = Field(description="Why nothing is written any more; null where all is well.")
    continued: str | None = Field(
        description="What became of the file that this recording was in before, and where it goes on; null: nothing."
    )
    notes: list[dict[str, Any]] = Field(
        description="The newest notes and markers of this recording, or the last: event, tick, text or name and value."
    )


class Noted(Reply):
    """What was noted, and where."""

    path: str = Field(description="Of the recording.")
    event: Literal["note", "marker"]
    tick: int = Field(description="Servo tick at which it was said.")


class SelfCheck(Reply):
    """What the daemon found when it looked at one thing, which it does once a second."""

    what: str = Field(description="What was looked at: socket, threads, run_file, room or another.")
    ok: bool = Field(description="Whether all was well, or was mended, at the last look.")
    found: str | None = Field(
        description="What was not as it should be when something was last; null where it never was."
    )
    done: str | None = Field(description="What was done about it, or what a person can do.")
    time: str | None = Field(description="When that was found, UTC, ISO 8601.")
    age_s: float = Field(description="Time since the last look ended, s; large where it hangs.")
    figures: dict[str, float | None] = Field(
        description="Numbers of the last look, their unit in the name: minutes_left (of recording, until the disk is full)."
    )


class Experiment(Reply):
    """The newest experiment."""

    id: int = Field(description="Number of the experiment, 0 when there was none.")
    kind: str | None = Field(description="release, sequence, or the name of an excitation.")
    state: Literal["idle", "running", "done", "aborted"]
    progress: float = Field(ge=0, le=1)
    result: dict[str, Any] | None


class Energy(Reply):
    """Energies since the last start, J, estimated through the plant model; ``unexplained`` is a hand's or the model's."""

    estimate: str
    stored_J: float
    stored_at_start_J: float
    dissipated_J: float
    generated_J: float
    settings_J: float
    unexplained_J: float


class Passivity(Reply):
    """What the passivity observer has booked since the last start, from counts and currents; null where it is off."""

    mode: Literal["off", "observe", "control"]
    put_out_J: float | None = Field(description="Work of the current sent, J.")
    generated_J: float | None = Field(description="Of it what the spring had not stored, J.")
    excess_J: float | None = Field(description="Of that what is still to be dissipated, J.")
    dissipated_J: float | None = Field(description="Dissipated by the controller, J.")
    current: float | None = Field(description="That the controller adds now, A.")


class Predicted(Reply):
    """What the loop, run ahead on the config's own plant, does in the soft start and a second more."""

    stored_energy_J: float = Field(description="Largest energy of the whole spring on the way, J.")
    peak_current_A: float
    peak_speed: float = Field(description="rad/s or m/s; against safety.max_velocity.")
    excursion: float = Field(description="Farthest from the spring's origin, rad or m; against safety.max_excursion.")
    fault: str | None = Field(description="The trip that would end it; null for none.")


class Guard(Reply):
    """What the stability guard says."""

    verdict: Literal["admitted", "warned", "forced", "refused", "off"]
    reason: str = Field(description="The sentence behind it, with the region and its limit.")
    region: str | None
    force: bool = Field(description="Whether a refusal was overridden.")
    predicted: Predicted | None = Field(
        description="null where the loop was not run ahead: for a release or an excitation, and with nothing rendered."
    )


class Status(Reply):
    """The daemon's state."""

    state: Literal["off", "ready", "running", "fault"]
    fault: Fault | None
    config_digest: str
    timing: Timing
    operating_point: OperatingPoint
    position: float | None = Field(description="From the spring's origin, rad or m.")
    enable: Enable
    position_unknown: str | None = Field(
        description="Why the origin's place is not known, and what to do; null where it is. Until then nothing is rendered."
    )
    position_ticks: float | None = Field(description="The same in coarse ticks.")
    velocity: float | None = Field(description="Estimate from the encoder, rad/s or m/s.")
    current: float | None = Field(description="Commanded, A.")
    current_measured: float | None = Field(description="As the device reports it, A; null where it does not.")
    force: float | None = Field(description="Rendered by the spring, N m or N.")
    units: dict[str, str] = Field(description="Units of position, velocity, current and force.")
    energy: Energy
    passivity: Passivity
    limits_off: list[str] = Field(description="Keys of the limits that are 0 or null, which means none.")
    log_lines_dropped: int = Field(description="Lines of the log that were lost because nobody read them in time.")
    recorder: RecorderStatus
    experiment: Experiment | None
    self_check: list[SelfCheck]


class JudgedStatus(Status):
    """The daemon's state, and what the guard said of the spring."""

    guard: Guard | None = Field(description="null where nothing has begun or changed that theory looks at.")


class SetReply(Reply):
    """What was set."""

    applied: dict[str, Any]
    config_digest: str
    guard: Guard | None = Field(description="null where no setting has changed that theory looks at.")


class JobReply(Reply):
    """An experiment has started; poll /experiment until it is done or aborted."""

    experiment: int = Field(description="Number of the experiment.")
    duration_s: float
    run: str | None = Field(description="Run file being recorded.")
    guard: Guard


class ReleaseReply(JobReply):
    """A release has started."""

    achieved_deflection: float = Field(description="Deflection really achieved, coarse ticks, exact to one raw count.")
    soft_start_s: float = Field(
        description="0: a release begins with the whole force, whatever safety.soft_start_s says."
    )


class SequenceReply(JobReply):
    """A sequence has started; ``run`` is that of its first step."""

    sequence: str = Field(description="Its name.")
    steps: int = Field(description="How many releases.")
