"""The diagrams of Fig. 9: what their loops enclose, and their forces at one place."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.reproduce.spring_diagrams import SPRINGS, press_and_release, spring_diagrams
from hapticd.stability.storage import FloatArray


@pytest.mark.parametrize("tau_d", [0.0, 0.4, 1.0, 1.25])
def test_diagrams_enclose_the_generated_energy(tau_d: float) -> None:
    found = spring_diagrams(press_and_release(5.3, 12.0), 12, tau_d)
    assert list(found.work) == list(SPRINGS) == list(found.force)
    assert found.work["physical"] == pytest.approx(0.0, abs=1e-12)
    assert found.work["quantised"] == pytest.approx(0.0, abs=1e-12)
    for name in ("sampled", "digital", "delayed"):
        # the shoelace formula on the closed curve, the steps at fixed ξ included
        x, f = np.append(found.xi, found.xi[0]), np.append(found.force[name], found.force[name][0])
        area = 0.5 * float(np.sum(f[:-1] * x[1:] - f[1:] * x[:-1]))
        assert found.generated(name) == pytest.approx(area, rel=1e-9, abs=1e-9)


def test_a_sampled_spring_generates_half_the_square_of_every_step() -> None:
    motion = press_and_release(5.3, 12.0)
    samples = motion(np.arange(13.0))
    found = spring_diagrams(motion, 12)
    assert found.generated("sampled") == pytest.approx(0.5 * float(np.sum(np.diff(samples) ** 2)), rel=1e-9)
    assert np.array_equal(found.force["delayed"], found.force["digital"])


def test_forces_of_the_five_springs_at_one_place() -> None:
    def motion(tau: FloatArray) -> FloatArray:
        return np.asarray(0.8 * tau)

    found = spring_diagrams(motion, 3, tau_d=0.5, points=4)
    at = int(np.flatnonzero(np.isclose(found.tau, 2.25))[0])
    shown = {name: float(force[at]) for name, force in found.force.items()}
    assert shown == pytest.approx(
        {"physical": -1.8, "quantised": -1.5, "sampled": -1.6, "digital": -1.5, "delayed": -0.5}
    )


def test_diagrams_refuse_what_has_no_meaning() -> None:
    with pytest.raises(ValueError, match="at least one period"):
        spring_diagrams(press_and_release(1.0, 1.0), 0)
