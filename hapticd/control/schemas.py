"""Bodies and replies of the control API as pydantic models, for the OpenAPI document and for checks.

Requests are checked strictly: unknown fields, numbers as strings and non-finite numbers are rejected. Replies are only
described here, and sent without a check.
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
    """The model of an endpoint's body, with the method's parameters as fields; None if it has no body."""
    if not endpoint.reads_body:
        return None
    fields: dict[str, Any] = {
        name: (parameter.annotation, Field(_default(parameter), description=endpoint.help_of(name)))
        for name, parameter in endpoint.signature.parameters.items()
    }
    name = "".join(part.title() for part in endpoint.name.split("_")) + "Body"
    return create_model(name, __base__=Request, __doc__=f"Body of {endpoint.path}.", **fields)


def reply_of(endpoint: Endpoint) -> type[Reply] | None:
    """The model of an endpoint's reply; None if there is none."""
    return None if endpoint.reply in (None, TEXT) else globals()[str(endpoint.reply)]


def _default(parameter: Parameter) -> Any:
    return ... if parameter.default is Parameter.empty else parameter.default


class ErrorDetail(BaseModel):
    """Why a request was not executed."""

    code: str = Field(
        description="Short stable name: request, json, too_large, config, excitation, unstable, driver, internal or another."
    )
    message: str = Field(description="A sentence for the user: what is wrong, where, and what is valid.")
    problems: list[dict[str, Any]] | None = Field(
        None, description="For code config: file, key, value, message, limit, unit and nearest of each wrong setting."
    )
    reason: str | None = Field(None, description="The message without the remedy, if there is one.")
    remedies: list[dict[str, Any]] | None = Field(
        None,
        description="Changes, each of which is sufficient: key, before, after, unit, words, region_after, buzz_after, "
        "and, in a sequence, step.",
    )
    help: str | None = Field(None, description="Remedy if no single change is sufficient.")
    force: bool | None = Field(None, description="Whether the same request with force would be executed.")


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
    remedy: str = Field(description="Remedy.")
    time: str | None = Field(description="When it was latched, UTC, ISO 8601; null if unknown.")
    config: str | None = Field(description="Name of the configuration under which it was latched.")
    config_digest: str | None = Field(description="Digest of that configuration.")
    not_latched: str | None = Field(description="Why it would be lost at a restart; null if it is on disk.")
    from_before: bool = Field(description="Whether it was latched before the daemon started.")


class Percentiles(Reply):
    """Percentiles of a time, in microseconds."""

    p50: float | None
    p99: float | None
    p999: float | None
    max: float | None


class Pace(Reply):
    """Timing of the servo loop over some time."""

    ticks: int = Field(description="Ticks executed.")
    missed: int = Field(description="Periods skipped.")
    exchanges_missed: int = Field(description="Failed exchanges with the device.")
    wake_us: Percentiles = Field(description="How late the loop woke.")
    exec_us: Percentiles = Field(description="How long a tick took.")
    verdict: str = Field(description="Whether the loop kept up, in words.")


class RecentPace(Pace):
    """Recent timing of the servo loop; the maxima are accurate to 3 %."""

    span_s: float = Field(description="Time of the statistics, s; shorter than in its name soon after the start.")


class Timing(Pace):
    """Timing of the servo loop since its start."""

    rate_hz: float = Field(description="Configured rate in Hz.")
    last_10_s: RecentPace = Field(description="The same over the last 10 s.")
    last_60_s: RecentPace = Field(description="The same over the last 60 s.")


class OperatingPoint(Reply):
    """Dimensionless numbers of the paper's Table I, from the model."""

    mu: float | None
    beta: float | None
    sigma: float | None
    tau_d: float | None
    region: str | None


class Enable(Reply):
    """The enable input that a person holds."""

    required: bool = Field(description="Whether the motor moves only while it is held (safety.enable).")
    held: bool | None = Field(description="Whether it is held; null if the driver has none.")


class RecorderStatus(Reply):
    """The recorder."""

    path: str | None = Field(description="File being written, or the last one; null if there is none.")
    rows: int = Field(description="Rows written.")
    dropped: int = Field(description="Rows lost because the writer fell behind.")
    error: str | None = Field(description="Why writing has stopped; null otherwise.")
    continued: str | None = Field(
        description="Why this recording continues in another file, and which; null if it does not."
    )
    notes: list[dict[str, Any]] = Field(
        description="The newest notes and markers of this recording, or the last: event, tick, text or name and value."
    )


class Noted(Reply):
    """The note or marker, and its recording."""

    path: str = Field(description="Of the recording.")
    event: Literal["note", "marker"]
    tick: int = Field(description="Servo tick of the note or marker.")


class SelfCheck(Reply):
    """Result of one of the daemon's checks, which run once a second."""

    what: str = Field(description="What is checked: socket, threads, run_file, room or another.")
    ok: bool = Field(description="Whether the last check found no problem, or repaired it.")
    found: str | None = Field(description="The last problem; null if there was none.")
    done: str | None = Field(description="What was done about it, or the remedy.")
    time: str | None = Field(description="When that was found, UTC, ISO 8601.")
    age_s: float = Field(description="Time since the end of the last check, s; large if it hangs.")
    figures: dict[str, float | None] = Field(
        description="Numbers of the last check, with the unit in the name: minutes_left (recording time of the disk)."
    )


class Experiment(Reply):
    """The newest experiment."""

    id: int = Field(description="Number of the experiment, 0 when there was none.")
    kind: str | None = Field(description="release, sequence, or the name of an excitation.")
    state: Literal["idle", "running", "done", "aborted"]
    progress: float = Field(ge=0, le=1)
    result: dict[str, Any] | None


class Energy(Reply):
    """Energies since the last start, J, from the plant model; ``unexplained``: work of a hand, or a model error."""

    estimate: str
    stored_J: float
    stored_at_start_J: float
    dissipated_J: float
    generated_J: float
    settings_J: float
    unexplained_J: float


class Passivity(Reply):
    """Energies of the passivity observer since the last start, from counts and currents; null if it is off."""

    mode: Literal["off", "observe", "control"]
    put_out_J: float | None = Field(description="Work of the commanded current, J.")
    generated_J: float | None = Field(description="Part of it that the spring had not stored, J.")
    excess_J: float | None = Field(description="Part of that not dissipated yet, J.")
    dissipated_J: float | None = Field(description="Dissipated by the controller, J.")
    current: float | None = Field(description="Present current of the controller, A.")


class Predicted(Reply):
    """Simulation of the loop on the config's plant, through the soft start and a second more."""

    stored_energy_J: float = Field(description="Largest potential energy of the spring, J.")
    peak_current_A: float
    peak_speed: float = Field(description="rad/s or m/s; compare safety.max_velocity.")
    excursion: float = Field(
        description="Largest distance from the spring's origin, rad or m; compare safety.max_excursion."
    )
    fault: str | None = Field(description="The trip that would end it; null for none.")


class Guard(Reply):
    """Judgement of the stability guard."""

    verdict: Literal["admitted", "warned", "forced", "refused", "off"]
    reason: str = Field(description="Reason in a sentence, with the region and its limit.")
    region: str | None
    force: bool = Field(description="Whether a refusal was overridden.")
    predicted: Predicted | None = Field(
        description="null without a simulation: for a release or an excitation, and if nothing is rendered."
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
        description="Why the origin's position is unknown, and the remedy; null if it is known. Nothing is rendered then."
    )
    position_ticks: float | None = Field(description="The same in coarse ticks.")
    velocity: float | None = Field(description="Estimate from the encoder, rad/s or m/s.")
    current: float | None = Field(description="Commanded, A.")
    current_measured: float | None = Field(description="Measured by the device, A; null if it does not.")
    force: float | None = Field(description="Rendered by the spring, N m or N.")
    units: dict[str, str] = Field(description="Units of position, velocity, current and force.")
    energy: Energy
    passivity: Passivity
    limits_off: list[str] = Field(description="Keys of limits that are off (0 or null).")
    log_lines_dropped: int = Field(description="Lost lines of the log, which were not read in time.")
    recorder: RecorderStatus
    experiment: Experiment | None
    self_check: list[SelfCheck]


class JudgedStatus(Status):
    """The daemon's state, and the guard's judgement of the spring."""

    guard: Guard | None = Field(description="null if nothing relevant for stability has started or changed.")


class SetReply(Reply):
    """What was set."""

    applied: dict[str, Any]
    config_digest: str
    guard: Guard | None = Field(description="null if no setting relevant for stability has changed.")


class JobReply(Reply):
    """An experiment has started; poll /experiment until it is done or aborted."""

    experiment: int = Field(description="Number of the experiment.")
    duration_s: float
    run: str | None = Field(description="Run file being recorded.")
    guard: Guard


class ReleaseReply(JobReply):
    """A release has started."""

    achieved_deflection: float = Field(description="Achieved deflection, coarse ticks, exact to one raw count.")
    soft_start_s: float = Field(description="0: a release starts with the full force, whatever safety.soft_start_s is.")


class SequenceReply(JobReply):
    """A sequence has started; ``run`` is the file of its first step."""

    sequence: str = Field(description="Its name.")
    steps: int = Field(description="Number of releases.")
