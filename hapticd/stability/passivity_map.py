"""What the passivity controller makes of the points of a region map that do not come to rest (Fig. 6), by exact simulation.

Every point of the study is run bare and with the controller, for an encoder whose count is the tick of the spring, and for
one of many counts a tick (`encoder.decimation`), where ticks hide less of the way. Three answers:

* a point that grew or went on, and comes to rest with the controller, is *made stable*;
* one that still goes on is *bounded*: the controller takes out what it sees, and below the encoder's grain it sees nothing.
  Where σ < ½ nothing can rest at all: no tick has a force that Coulomb friction holds;
* one that came to rest without it and no longer does is *spoilt*.

What it costs is the largest force that it adds, in ticks of force KΔ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.criterion import lambda_
from hapticd.stability.maps import GROWING, PERSISTENT, Study
from hapticd.stability.sampled_loop import run_in_threads
from hapticd.stability.whole_loop import blank

#: Counts a tick: the coarsest encoder, and the paper's decimation.
COUNTS: Final = (1, 217)
#: What became of a point.
CALM_ANYWAY, MADE_STABLE, BOUNDED, STILL_GROWS, SPOILT = range(5)
NAMES: Final = ("calm anyway", "made stable", "bounded", "still grows", "spoilt")


@dataclass(frozen=True)
class PassivityMap:
    """A study with and without the controller.

    Attributes:
        study: the grid of maps. counts: a tick, as the controller reads them.
        bare: of `RUN`, shape ``study.shape``. controlled: for each of ``counts``.
        classes: CALM_ANYWAY … SPOILT of each point, for each of ``counts``.
    """

    study: Study
    counts: tuple[int, ...]
    bare: NDArray[Any]
    controlled: dict[int, NDArray[Any]]
    classes: dict[int, NDArray[np.int8]]

    @property
    def report(self) -> dict[str, Any]:
        """The JSON document: for each delay and number of counts a tick, fractions and cost."""
        rows = []
        sigma = np.broadcast_to(self.study.sigmas, self.study.shape)
        for d, tau_d in enumerate(self.study.delays):
            for counts in self.counts:
                of, run, bare = self.classes[counts][d], self.controlled[counts][d], self.bare[d]
                shaky = bare["outcome"] >= PERSISTENT
                holds = shaky & (sigma[d] >= 0.5)
                rescued = of == MADE_STABLE
                ratio = run["added"][rescued] / run["largest"][rescued]
                rows.append(
                    {
                        "tau_d": tau_d,
                        "counts_per_tick": counts,
                        "points": int(of.size),
                        "unstable": int(shaky.sum()),
                        "growing": int((bare["outcome"] == GROWING).sum()),
                        **{name.replace(" ", "_"): int((of == code).sum()) for code, name in enumerate(NAMES)},
                        "share_made_stable": _fraction(rescued, shaky),
                        "share_made_stable_where_friction_holds_a_tick": _fraction(rescued, holds),
                        "added_force_ticks": _middle_and_most(run["added"][rescued]),
                        "added_force_share": _middle_and_most(ratio),
                        "left_amplitude_ticks": _middle_and_most(run["amplitude"][of == BOUNDED]),
                    }
                )
        return {"mu": self.study.mu, "periods": self.study.periods, "maps": rows}


def _fraction(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float | None:
    return float((part & whole).sum() / whole.sum()) if whole.any() else None


def _middle_and_most(values: NDArray[np.float64]) -> dict[str, float | None]:
    if not values.size:
        return {"median": None, "max": None}
    return {"median": float(np.median(values)), "max": float(values.max())}


def passivity_map(study: Study, counts: tuple[int, ...] = COUNTS, jobs: int | None = None) -> PassivityMap:
    """Run a study with and without the controller.

    Args:
        study: which points. counts: a tick, each a variant.
        jobs: threads; None for one per core that this process may use.
    """
    loops = _loops(study)
    bare = run_in_threads(loops, study.periods, jobs)
    controlled, classes = {}, {}
    for number in counts:
        loops["counts"] = number
        controlled[number] = run_in_threads(loops, study.periods, jobs)
        classes[number] = classify(bare["outcome"], controlled[number]["outcome"])
    return PassivityMap(study, counts, bare, controlled, classes)


def classify(bare: NDArray[np.int64], controlled: NDArray[np.int64]) -> NDArray[np.int8]:
    """What the controller made of points with these outcomes."""
    calm_before, calm_after = bare < PERSISTENT, controlled < PERSISTENT
    grows = controlled == GROWING
    found = np.select(
        [calm_before & calm_after, calm_before, calm_after, grows],
        [CALM_ANYWAY, SPOILT, MADE_STABLE, STILL_GROWS],
        BOUNDED,
    )
    return found.astype(np.int8)


def _loops(study: Study) -> NDArray[Any]:
    loops = blank(study.shape)
    loops["mu"] = study.mu
    loops["sigma"] = study.sigmas
    for d, tau_d in enumerate(study.delays):
        loops["tau_d"][d] = tau_d
        loops["beta"][d] = study.betas(tau_d)[None, :, None]
        loops["stiffest"][d] = 2.0 * float(lambda_(tau_d))  # αT = 2 b_p (`hapticd.stability.passivity`)
    loops["xi_dot"] = np.array(study.velocities)[None, :, None, None]
    return loops
