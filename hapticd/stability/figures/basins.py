"""Basins of attraction in the plane (ξ, ξ̇): of rest, of each cycle and of growth, by exact simulation.

Both axes are linear up to the largest cycle below one tick, and logarithmic beyond: this shows the basins of small cycles
and the whole range that the limits admit. The starts are those of ``hapticd simulate``: the servo's memory is empty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.figures.style import GREY, INK, ORANGE, RED, STABLE, UNSTABLE
from hapticd.stability.assessment import Assessment
from hapticd.stability.cycles import AT_REST, ONE_TICK, UNDECIDED, WANDERS, answers_of, growing, sorted_into
from hapticd.stability.explore import admitted, threads
from hapticd.stability.explored import Explored
from hapticd.stability.starts import HEAVIEST, alone, horizon
from hapticd.stability.storage import FloatArray
from hapticd.stability.whole_loop import record_of

#: Cells along an axis of the first and of the finest grid, and periods that the grid may take.
_COARSE, _FINEST, _PERIODS = 16, 112, 10_000_000
_LONGEST: Final = 20_000
#: Cycles that have a colour of their own.
_SHOWN: Final = 8


@dataclass(frozen=True)
class Basins:
    """Final states of starts on a grid.

    Attributes:
        xi: (n + 1,) edges of the cells in ticks. xi_dot: the same in ticks per period. linear: ends of the linear parts.
        ends: (n, n) indices into ``names``, by ξ̇ and ξ.
        names: of the final states, as in `Explored.ends`; the first is for starts that the limits do not admit.
    """

    xi: FloatArray
    xi_dot: FloatArray
    linear: tuple[float, float]
    ends: NDArray[np.int64]
    names: tuple[str, ...]


def basins(found: Assessment, jobs: int | None = None) -> Basins:
    """Run a grid of starts over the admitted range, as fine as a fixed number of periods allows.

    Args:
        found: a configuration with a spring, and its motion if one was requested.
        jobs: threads, None for one per core that this process may use; the result does not depend on it.
    """
    record = record_of(found.config, found.loop)
    motion = None if found.start is None else (found.deflection or 0.0, found.velocity or 0.0)
    reach, widest = admitted(found.config, found.loop, record, motion)
    reach, weight = max(reach, 0.5), math.sqrt(min(float(record["mu"][0]), HEAVIEST))
    place, speed = _linear_up_to(found, weight)
    far = 1.05 * math.asinh(reach / place), 1.05 * math.asinh(reach / weight / speed)
    longest = horizon(record, reach, _LONGEST)
    with threads(jobs) as run:

        def look(n: int) -> tuple[NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
            middle = (2.0 * np.arange(n) + 1.0 - n) / n
            x, v = np.meshgrid(place * np.sinh(far[0] * middle), speed * np.sinh(far[1] * middle))
            stored = x * x * (1.0 + record["kappa"][0]) + (weight * v) ** 2
            inside = (stored <= reach**2) & (np.abs(x) <= widest)
            begun = alone(record, x[inside], v[inside])
            return inside, begun, run(begun, longest, 64)

        mean = float(np.mean(look(_COARSE)[2]["periods"]))
        n = int(np.clip(math.sqrt(_PERIODS / max(mean, 1.0)), _COARSE, _FINEST))
        inside, begun, runs = look(n)
    answers, (cycles, which) = answers_of(begun, runs), sorted_into(runs)
    names = ("not admitted", "rest", "growth", "undecided", *(cycle.words for cycle in cycles))
    cells = np.select([answers == AT_REST, growing(runs), answers == UNDECIDED], [1, 2, 3], which + 4)
    edges = np.linspace(-1.0, 1.0, n + 1)
    # cycles above one tick have one name for all amplitudes
    once = tuple(dict.fromkeys(names))
    ends = np.zeros(inside.shape, np.int64)
    ends[inside] = np.array([once.index(name) for name in names])[cells]
    return Basins(place * np.sinh(far[0] * edges), speed * np.sinh(far[1] * edges), (place, speed), ends, once)


def _linear_up_to(found: Assessment, weight: float) -> tuple[float, float]:
    """Ticks, and ticks per period, of the largest cycle below one tick; of one tick if there is none."""
    cycles = found.explored.cycles if found.explored is not None else ()
    small = [cycle for cycle in cycles if cycle.periods and cycle.amplitude < ONE_TICK]
    if not small:
        return ONE_TICK, ONE_TICK / weight
    largest = max(small, key=lambda cycle: cycle.amplitude)
    return largest.amplitude, largest.amplitude * 2.0 * math.pi / largest.periods


def draw_basins(figure: Any, basins: Basins, explored: Explored) -> None:
    """Draw the basins into a figure, with the shares of all explored starts in the legend."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch
    from matplotlib.ticker import AsinhLocator

    shares: dict[str, float] = {}
    for share, name, _ in explored.ends:
        shares[name] = shares.get(name, 0.0) + share
    seen = np.bincount(basins.ends.ravel(), minlength=len(basins.names))
    colours = ["white", STABLE, UNSTABLE, INK, *[GREY] * (len(basins.names) - 4)]
    cycles = sorted((k for k in range(4, len(basins.names)) if seen[k]), key=lambda k: -seen[k])
    wandering = [k for k in cycles if basins.names[k].startswith(WANDERS)]
    regular = [k for k in cycles if k not in wandering]
    told = sorted(regular[:_SHOWN], key=lambda k: (int(basins.names[k].split()[0]), k))
    for k, place in zip(told, np.linspace(0.0, 1.0, max(len(told), 2)), strict=False):
        colours[k] = colormaps["viridis"](place)
    for k in wandering:
        colours[k] = ORANGE if basins.names[k] == WANDERS else RED
    axes = figure.subplots()
    axes.pcolormesh(
        basins.xi, basins.xi_dot, basins.ends, cmap=ListedColormap(colours), vmin=-0.5, vmax=len(colours) - 0.5
    )
    axes.set_xscale("asinh", linear_width=basins.linear[0])
    axes.set_yscale("asinh", linear_width=basins.linear[1])
    axes.xaxis.set_major_locator(AsinhLocator(basins.linear[0], numticks=5))
    axes.yaxis.set_major_locator(AsinhLocator(basins.linear[1], numticks=5))
    axes.set_xlabel("position ξ (ticks)")
    axes.set_ylabel("velocity (ticks per period)")
    axes.set_title("final state of each start", loc="left", fontsize=12)
    patches = []
    for k in (1, 2, 3, *told, *wandering):
        if seen[k]:
            found = f": {100.0 * shares[basins.names[k]]:.2g} %" if basins.names[k] in shares else ""
            patches.append(Patch(color=colours[k], label=basins.names[k] + found))
    if others := len(regular) - len(told):
        patches.append(Patch(color=GREY, label=f"{others} other{'s' * (others > 1)}"))
    figure.legend(handles=patches, fontsize=8, loc="outside lower center", ncols=3, title="share of explored starts")
