"""What the rig is, and whether theory holds on it: identification, what the model lacks, Fig. 8, the largest stiffness."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.api.theory import check
from hapticd.client import RequestRefused, settings_for_a_while
from hapticd.commission.step import Picture, Result, Seen, StepError, line
from hapticd.config import load_config
from hapticd.config.editing import text_of
from hapticd.figures.files import write_text
from hapticd.gap.data import load_recording
from hapticd.gap.live import LiveError
from hapticd.gap.workflow import find_gap
from hapticd.hil.cases import FIG_8
from hapticd.hil.suite import judged, release
from hapticd.identify.config_file import with_plant
from hapticd.identify.live import record_live
from hapticd.identify.workflow import identify as identify_device
from hapticd.identify.workflow import load_any
from hapticd.record import read_run

if TYPE_CHECKING:
    from hapticd.commission.rig import Rig
    from hapticd.config import Config
    from hapticd.hil.daemon import DaemonProcess

INERTIA_FACTOR: Final = 1.5
KNOWN_TOLERANCE: Final = 0.1
DELAY_TOLERANCE_S: Final = 0.001
TRIALS: Final = (0.25, 0.5, 0.75, 0.95, 1.5, 2.5, 4.0, 6.0, 10.0)
"""Stiffness over what theory admits; the first that does not come to rest ends them."""
ADMITTED: Final = 0.95
TRIAL_S: Final = 1.0
ATTEMPTS: Final = 3
PULL: Final = 5.0
"""Force of the spring where a trial begins, over friction."""


def identify(rig: Rig) -> Result:
    """Plays chirps that grow until the shaft moves, then two of 12 s, and finds inertia, friction and delay."""
    config = rig.config
    with rig.daemon() as daemon:
        try:
            recordings = record_live(daemon.client, daemon.config, rig.say, rig.bar)
        except LiveError as error:
            raise StepError(str(error)) from error
        kept = [rig.keep(daemon.runs / recording.name) for recording in recordings]
    recordings = [load_any(path, config) for path in kept]
    with rig.bar("identify") as progress:
        found = identify_device(recordings, config, known_inertia=rig.given.inertia, progress=progress)
    rig.identified.parent.mkdir(parents=True, exist_ok=True)
    write_text(rig.identified, with_plant(text_of(None, config), found))
    ratio = found.inertia.value / config.plant.inertia
    implied = found.torque_constant_implied
    late = found.delay.ci95[0] - found.declared_delay_s
    figures: dict[str, Any] = {
        **{name: getattr(found, name).value for name in ("inertia", "viscous", "coulomb", "bias")},
        "delay_us": 1e6 * found.delay.value,
        "sign": found.sign,
        "inertia_over_config": ratio,
        "coulomb_over_config": found.coulomb.value / config.plant.coulomb if config.plant.coulomb else None,
        "torque_constant_implied": implied and implied.value,
        "recordings": [path.name for path in kept],
        "warnings": list(found.warnings),
        "config": rig.identified.name,
    }
    limit: dict[str, Any] = {
        "inertia_over_config": f"{1 / INERTIA_FACTOR:.2g} to {INERTIA_FACTOR:g}",
        "delay_us": 1e6 * (found.declared_delay_s + DELAY_TOLERANCE_S),
        "sign": 1,
    }
    seen = Seen(figures, limit, _motion(kept[-1], config))
    if found.sign < 0:
        return seen.fails(
            "the encoder counts against the torque", "a lead or a channel was exchanged since", "begin again"
        )
    if implied is not None:
        limit["torque_constant_implied"] = f"{config.amplifier.torque_constant:g} ± {100 * KNOWN_TOLERANCE:g} %"
        off = implied.value / config.amplifier.torque_constant
        if abs(off - 1.0) > KNOWN_TOLERANCE:
            return seen.fails(
                f"the inertia that was given needs a torque constant of {implied.value:.4g}, "
                f"{off:.3g} times the config's {config.amplifier.torque_constant:g}",
                "the constant of another winding or in another unit, or a current that is not what the drive says",
                f"amplifier.torque_constant: {implied.value:.4g}, if the inertia is right",
            )
    elif not 1.0 / INERTIA_FACTOR < ratio < INERTIA_FACTOR:
        return seen.fails(
            f"the inertia is {ratio:.3g} times the config's",
            "plant.inertia was a guess; or amplifier.torque_constant is off by that factor: counts and currents cannot tell",
            f"a step with a known weight tells; then go on with {rig.identified.name}",
        )
    if late > DELAY_TOLERANCE_S:
        return seen.fails(
            f"the current comes {1e6 * found.delay.value:.0f} µs after the sample, {1e6 * found.declared_delay_s:.0f} µs "
            "are declared",
            "a filter or a buffer in the drive",
            "switch it off, or declare it: driver.latency_s",
        )
    said = f"inertia {found.inertia.value:.4g}, {ratio:.3g} of the config's; delay {1e6 * found.delay.value:.0f} µs"
    return seen.passes(said)


def gap(rig: Rig) -> Result:
    """Compares the recordings with the identified model and names what is missing; nothing moves."""
    model = load_config(str(rig.identified))
    recordings = [load_recording(rig.runs / name, model) for name in rig.document("identify")["recordings"][1:]]
    with rig.bar("gap") as bar:
        found = find_gap(recordings, model, progress=lambda fraction, text: bar(fraction), design=False)
    figures = {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "statement": found.statement,
    }
    seen = Seen(figures, {"verdict": "not unexplained"})
    if found.verdict == "unexplained":
        return seen.fails(
            found.statement,
            "the rig does something that no law of the catalogue describes",
            "look at hapticd gap's report of the recordings",
        )
    return seen.passes(found.statement)


def fig_8(rig: Rig) -> Result:
    """Releases the shaft four times as in Fig. 8; the last of them grows on purpose until the over-speed trip ends it."""
    model = load_config(str(rig.identified))
    done, skips = [], []
    with rig.daemon(model) as daemon:
        for case in FIG_8:
            try:
                done.append(release(daemon, case))
            except RequestRefused as refusal:
                skips.append(f"{case.name}: {refusal.message}")
    if not done:
        raise StepError("; ".join(skips))
    cases = []
    with rig.bar("simulating") as bar:
        for each in done:
            cases.append(judged(each))
            bar(len(cases) / len(done))
    figures: dict[str, Any] = {"refused": skips}
    for one in cases:
        figures[f"{one.name}_outcome"] = one.report["outcome"]
        figures[f"{one.name}_current_error"] = one.comparison.current_rms_error
    limit = {f"{one.name}_outcome": one.report["simulated_outcome"] for one in cases}
    first = cases[0].comparison
    picture = Picture(
        "s",
        "coarse ticks",
        (
            line(f"{cases[0].name}, simulated", first.simulated.time_s, first.simulated.ticks),
            line(f"{cases[0].name}, on the rig", first.measured.time_s, first.measured.ticks),
        ),
    )
    problems = [f"{one.name}: {'; '.join(one.problems)}" for one in cases if one.problems]
    disturbed = [one.name for one in cases if one.problems and one.report["disturbances"]]
    figures["disturbed"] = disturbed
    if problems and len(disturbed) == len(problems):
        names = ", ".join(disturbed)
        return Result("disturbed", f"in every try of {names}", figures, limit)
    seen = Seen(figures, limit, picture)
    if problems:
        return seen.fails(
            "; ".join(problems),
            "what gap has named above, or a delay that is not declared",
            "hapticd gap on these recordings; hapticd latency",
        )
    said = ", ".join(f"{one.name} {one.report['outcome']}" for one in cases)
    return seen.passes(f"as simulated: {said}")


def largest_stiffness(rig: Rig) -> Result:
    """Releases the shaft for 1 s each at growing stiffness, from a quarter of what theory admits, until it does not rest."""
    model = load_config(str(rig.identified))
    bounds = {key: value for key, value in check(model).document["stiffness_max"].items() if value}
    if not bounds or not np.isfinite(max(bounds.values())):
        return Result("skipped", "theory gives no largest stiffness for this rig", {"theory": None})
    theory = float(max(bounds.values()))
    tried: list[tuple[float, str]] = []
    with rig.daemon(model) as daemon:
        for share in TRIALS:
            tries = ATTEMPTS if share < 1.0 else 1  # a period that this machine misses is not the rig's
            outcome = ""
            for _ in range(tries):
                if outcome != "decaying":
                    outcome = _trial(daemon, model, share * theory)
            tried.append((share * theory, outcome))
            if outcome != "decaying":
                break
    rests = [stiffness for stiffness, outcome in tried if outcome == "decaying"]
    figures = {
        "theory": theory,
        "by_trial": max(rests, default=0.0),
        "first_that_does_not": tried[-1][0] if tried[-1][1] != "decaying" else None,
        "its_outcome": tried[-1][1],
        **{f"theory_{key}": value for key, value in bounds.items()},
    }
    limit = {"by_trial": ADMITTED * theory}
    xs, ys = zip(*((stiffness, float(outcome == "decaying")) for stiffness, outcome in tried), strict=True)
    picture = Picture("stiffness", "comes to rest", (line("trials", xs, ys, "dots"),), {"theory": theory})
    seen = Seen(figures, limit, picture)
    if figures["by_trial"] < ADMITTED * theory * (1.0 - 1e-9):
        return seen.fails(
            f"{tried[-1][1]} at {tried[-1][0]:.3g}, and theory promises rest up to {theory:.3g}",
            "a delay or an elasticity that the model does not have",
            "hapticd gap on the identification's recordings",
        )
    beyond = f"; {tried[-1][1]} at {tried[-1][0]:.3g}" if figures["first_that_does_not"] else ""
    said = f"theory {theory:.3g}, at rest up to {max(rests):.3g} by trial{beyond}"
    return seen.passes(said)


def _trial(daemon: DaemonProcess, model: Config, stiffness: float) -> str:
    """The outcome of a release at a stiffness, or the fault that ended it."""
    reach = PULL * model.plant.coulomb / stiffness
    if model.safety.max_excursion:
        reach = min(reach, 0.3 * model.safety.max_excursion)
    reach = max(reach, 4.0 * model.resolution)
    settings = {
        "spring.stiffness": stiffness,
        "servo.rate_hz": model.servo.rate_hz,
        "encoder.decimation": model.encoder.decimation,
    }
    with settings_for_a_while(daemon.client, settings, force=True):
        job = daemon.client.release(reach / model.resolution, TRIAL_S, force=True)
        found = daemon.client.wait(job["experiment"])["result"] or {}
        if daemon.client.status()["fault"]:
            daemon.client.clear()
        daemon.client.stop()
    return str(found.get("fault") or found.get("outcome"))


def _motion(path: Path, config: Config) -> Picture:
    columns = read_run(path).columns
    turns = (columns["encoder_counts"] - columns["encoder_counts"][0]) * config.raw_resolution
    return Picture("s", "m" if config.is_linear else "rad", (line("position", columns["time_s"], turns),))
