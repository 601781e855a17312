"""``simulate`` runs the daemon's own loop; it must end where the plain dimensionless loop over the plant ends."""

from __future__ import annotations

from typing import Any

import pytest

from hapticd.config import parse_config
from hapticd.servo.simulate import simulate
from tests.plant.test_fig8 import dimensionless

RELEASES = {
    "a": (1000.0, 217, 20.3, (1, 10, 100, 648, 649, 650, 3000)),
    "b": (1000.0, 2172, 3.3, (1, 10, 100, 1000, 20_000)),
    "c": (100.0, 217, 2.3, (1, 2, 3, 4, 5, 6, 7, 100)),
    "d": (100.0, 217, 10.3, (1, 10, 50, 200)),
}


def simulated(rate: float, decimation: int, deflection: float, periods: int) -> dict[str, Any]:
    config = parse_config(
        {
            "servo": {"rate_hz": rate},
            "encoder": {"decimation": decimation},
            "amplifier": {"bandwidth_hz": 0, "dac_bits": 0},
        },
        "test",
    )
    return simulate(config, periods / rate, deflection=deflection)


@pytest.mark.parametrize(
    ("case", "periods"), [(case, periods) for case, (*_, lengths) in RELEASES.items() for periods in lengths]
)
def test_the_daemon_s_loop_in_virtual_time_is_the_dimensionless_loop(case: str, periods: int) -> None:
    rate, decimation, deflection, _ = RELEASES[case]
    plain = dimensionless(rate, decimation, deflection, periods)
    report = simulated(rate, decimation, deflection, periods)
    assert report["ticks"] == periods
    assert report["final"]["position_ticks"] == pytest.approx(plain.position, rel=1e-11, abs=1e-9)


@pytest.mark.parametrize(("case", "periods", "end"), [("a", 649, -0.7251), ("c", 7, -0.9322)])
def test_the_shaft_moves_for_the_published_number_of_whole_periods_and_then_rests_for_good(
    case: str, periods: int, end: float
) -> None:
    release = RELEASES[case][:3]
    assert not simulated(*release, periods)["at_rest"]
    report = simulated(*release, periods + 1)
    assert report["at_rest"]
    assert report["final"]["velocity_ticks_per_period"] == 0.0
    assert report["final"]["position_ticks"] == pytest.approx(end, abs=5e-5)
    assert simulated(*release, 10 * periods)["final"] == report["final"]
