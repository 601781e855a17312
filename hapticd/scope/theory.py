"""What the page says of theory: the (β, σ) plane of the present μ and τ_D, its boundaries, and a setting not yet sent.

All numbers come from `hapticd.stability`; the page only draws them.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any, Final

import numpy as np

from hapticd.config import Config, apply_settings, config_digest, parse_config
from hapticd.servo.excitation import ALL, SHAPES, Shape, default_plan
from hapticd.stability.criterion import velocity_limit
from hapticd.stability.describing_function import predicted_cycle
from hapticd.stability.explore import Effort, explore
from hapticd.stability.numbers import Loop, loop_from_config
from hapticd.stability.regions import MEANING, critical_sigma, region
from hapticd.stability.report import number
from hapticd.stability.storage import equivalent_deflection, velocity_bound
from hapticd.stability.theorems import holds, proven
from hapticd.stability.zwidth import VERDICTS, zwidth

DEFLECTION: Final = 10.3
"""Motion for which the speed-dependent boundaries are drawn until the page asks for another, coarse ticks."""
EFFORT: Final = Effort(starts=1024, periods=2_000_000, horizon=20_000)
"""Some tenths of a second of a thread that nothing waits for but the page's one line."""
_TOLD: Final = 3
Z_POINTS: Final = 20
"""Along each axis of the (K, B) map: some seconds of one thread."""
BETA: Final = np.geomspace(1e-3, 1e2, 201)


def describe(document: dict[str, Any], latency_s: float = 0.0) -> dict[str, Any]:
    """All that the page needs of a config: itself, scales and units, the plane and the operating point.

    Args:
        document: the daemon's ``/config``.
        latency_s: sample-to-current latency of the daemon's driver, s.
    """
    config = parse_config(document, "the daemon's config")
    linear = config.is_linear
    length, force = ("m", "N") if linear else ("rad", "N m")
    return {
        "config": document,
        "digest": config_digest(config),
        "latency_s": latency_s,
        "scales": {
            "resolution": config.resolution,
            "raw_resolution": config.raw_resolution,
            "decimation": config.encoder.decimation,
            "period_s": config.period,
        },
        "units": {"position": length, "velocity": f"{length}/s", "current": "A", "force": force},
        "plane": plane(config, DEFLECTION, latency_s),
        "excitations": excitations(config),
    }


def excitations(config: Config) -> list[dict[str, Any]]:
    """What can be played, with the numbers that the daemon would choose: the fields of a form."""
    found: list[dict[str, Any]] = [{"name": ALL, "summary": "all of them, one after the other", "plan": {}}]
    for shape in SHAPES.values():
        chosen, unit = default_plan(config, shape), excitation_unit(shape, config.is_linear)
        plan = {
            "amplitude": {"value": chosen.amplitude, "unit": unit},
            "duration_s": {"value": chosen.duration_s, "unit": "s"},
        }
        if shape.sweeps_frequency:
            plan |= {
                "low_hz": {"value": chosen.low_hz, "unit": "Hz"},
                "high_hz": {"value": chosen.high_hz, "unit": "Hz"},
            }
        found.append({"name": shape.name, "summary": shape.summary, "plan": plan})
    return found


def excitation_unit(shape: Shape, linear: bool) -> str:
    """Of its amplitude."""
    if not shape.moves_origin:
        return "A"
    return "m" if linear else "rad"


def plane(config: Config, deflection: float = DEFLECTION, latency_s: float = 0.0) -> dict[str, Any]:
    """Operating point, regions and boundaries.

    Returns:
        ``point`` (see `_point`), ``beta_line`` (½ + τ_D), ``sigma_line`` (q), ``beta`` (201 values) and on it
        ``paper``, the σ that the criterion asks for in a release from ``deflection``.
    """
    loop = loop_from_config(config, latency_s)
    n = loop.numbers
    lines = {
        "point": _point(loop, deflection),
        "beta_line": 0.5 + n.tau_d,
        "sigma_line": n.quantum,
    }
    if math.isinf(n.mu):
        return {**lines, "beta": [], "paper": []}
    top = float(velocity_bound(deflection, 0.0, n.mu, n.tau_d, n.kappa))
    return {**lines, "beta": BETA, "paper": critical_sigma(n, top, BETA)}


def preview(document: dict[str, Any], settings: dict[str, Any], deflection: float, latency_s: float) -> dict[str, Any]:
    """Where settings that are not sent yet would put the operating point, the boundaries that would hold there included.

    Raises:
        ConfigError: a setting is wrong.
    """
    config = parse_config(document, "the daemon's config")
    return plane(apply_settings(config, settings, source="settings"), deflection, latency_s)


def ends(document: dict[str, Any], latency_s: float = 0.0) -> dict[str, Any]:
    """In what the starts end that the safety limits admit, as one line; `explore` keeps it by config.

    Returns:
        ``words``; ``starts`` that were run, 0 where a theorem or the lack of a spring makes that needless.
    """
    config = parse_config(document, "the daemon's config")
    loop = loop_from_config(config, latency_s)
    if loop.stiffness == 0.0:
        return {"words": "no spring", "starts": 0}
    if holds(config, loop, None):
        sure = proven(config, loop, None)
        return {"words": f"rest 100 %, {'proven' if sure else 'if what is assumed is true'}", "starts": 0}
    found = explore(config, loop=loop, effort=EFFORT)
    parts = [f"{name} {number(100.0 * share, 2)} %" for share, name, _ in found.ends[:_TOLD]]
    if others := found.ends[_TOLD:]:
        parts.append(
            f"{len(others)} other{'s' * (len(others) > 1)} {number(100.0 * sum(share for share, _, _ in others), 2)} %"
        )
    if 0.0 < found.largest_cycle < math.inf:
        parts.append(f"largest ±{number(found.largest_cycle, 2)} ticks")
    return {"words": "; ".join(parts), "starts": found.starts}


def z_map(document: dict[str, Any], latency_s: float) -> dict[str, Any]:
    """Which stiffness and damping the device can render (`hapticd.stability.zwidth`), coarsely; the spring does not matter.

    Returns:
        ``stiffness`` (m,), ``damping`` (n,), ``outcome`` (n, m) as index into ``verdicts``, ``exact`` and ``linear`` (n,).
    """
    spring = {"spring": {**document["spring"], "stiffness": 0.0, "damping": 0.0, "origin": 0.0}}
    return _z_map(json.dumps(document | spring), latency_s)


@lru_cache(maxsize=8)
def _z_map(document: str, latency_s: float) -> dict[str, Any]:
    found = zwidth(parse_config(json.loads(document), "the daemon's config"), latency_s, count=Z_POINTS, jobs=1)
    columns = ("stiffness", "damping", "outcome", "exact", "linear")
    return {"verdicts": list(VERDICTS), **{name: getattr(found, name).tolist() for name in columns}}


def _point(loop: Loop, deflection: float) -> dict[str, Any]:
    """The numbers of Table I, the region of every motion and of this release, in words, and the limits of speed."""
    n = loop.numbers
    top = None if math.isinf(n.mu) else float(velocity_bound(deflection, 0.0, n.mu, n.tau_d, n.kappa))
    anywhere, here = region(n), region(n, top)
    limit = velocity_limit(n)
    far = math.inf if math.isinf(limit) or math.isinf(n.mu) else float(equivalent_deflection(limit, n.mu))
    cycle = predicted_cycle(n)
    return {
        "mu": n.mu,
        "beta": n.beta,
        "sigma": n.sigma,
        "tau_d": n.tau_d,
        "region": anywhere,
        "words": MEANING[anywhere],
        "deflection": deflection,
        "region_here": here,
        "words_here": MEANING[here],
        "velocity_limit": {"ticks_per_period": limit, "si": limit * loop.resolution / loop.period},
        "deflection_limit": {"ticks": far, "si": far * loop.resolution},
        "cycle": cycle and {"ticks": cycle.amplitude, "hz": loop.scales.omega_to_hz(cycle.omega)},
    }
