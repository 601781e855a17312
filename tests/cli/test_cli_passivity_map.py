"""``hapticd map --passivity``, and ``hapticd check`` with damping: what they answer and refuse."""

from __future__ import annotations

import pytest

from hapticd.stability.criterion import lambda_
from hapticd.stability.maps import Study
from hapticd.stability.passivity_map import BOUNDED, MADE_STABLE, STILL_GROWS, passivity_map

from .conftest import Run


def test_the_controller_stops_what_grows_and_not_what_cannot_rest() -> None:
    study = Study(delays=(0.0,), velocities=(10.0,), beta_count=6, sigma_count=8, sigma_max=2.8, periods=4000)
    found = passivity_map(study, jobs=1)
    row = found.report["maps"][0]
    assert row["growing"] > 0
    assert row["share_made_stable_where_friction_holds_a_tick"] == 1.0
    for classes in found.classes.values():
        assert not (classes == STILL_GROWS).any()
        assert (classes == MADE_STABLE).any()
        assert set(classes[0, 0][:, study.sigmas < 0.5].ravel().tolist()) == {BOUNDED}


def test_dask_is_for_the_maps(hapticd: Run) -> None:
    answer = hapticd("map", "--passivity", "--dask", "tcp://nowhere:1")
    assert answer.code == 2
    assert "--dask is for the maps" in answer.err


def test_check_prints_the_bound_and_runs_the_exact_loop(hapticd: Run) -> None:
    case = ("--set", "servo.rate_hz=100", "--set", "encoder.decimation=217", "--deflection", "10.3")
    assert hapticd("check", *case, "--json").document["explored"]["moving_on"] > 0
    answer = hapticd("check", *case, "--set", "spring.damping=3e-4", "--json")
    assert answer.document["explored"]["moving_on"] == 0
    damping = answer.document["damping"]
    assert damping["beta_v"] == pytest.approx(2.5)
    least = 0.012e-2 * float(lambda_(answer.document["tau_d"], 2.5))
    assert damping["passive"]["viscous_least"] == pytest.approx(least)
    assert not damping["passive"]["holds"]
