"""``hapticd map --zwidth`` and ``--passivity``, and ``hapticd check`` with damping: what they answer and refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.config import load_config
from hapticd.stability.criterion import lambda_
from hapticd.stability.maps import Study
from hapticd.stability.passivity_map import BOUNDED, MADE_STABLE, STILL_GROWS, passivity_map
from hapticd.stability.zwidth import DIES_OUT, zwidth

from .conftest import Run


def test_zwidth_agrees_with_what_is_known_of_it() -> None:
    found = zwidth(load_config(None), 0.0, count=16, periods=1500, jobs=1)
    limit = {variant: found.largest(variant).max() for variant in found.outcome}
    assert limit["linear"] < limit["coulomb"]
    assert limit["ticks"] <= limit["linear"]
    # well within the passive springs all motions die out
    assert found.passive[0] == pytest.approx(9e-6 / (1e-3 * float(lambda_(found.loop.delay / 1e-3))))
    assert (np.diff(found.passive) <= 0.0).all()
    most = 0.5 * found.passive[0]
    finer = zwidth(load_config(None), 0.0, count=6, periods=12000, stiffness_max=most, damping_max=1e-6, jobs=1)
    assert found.stiffness[0] > finer.stiffness[-1]
    for variant in ("linear", "coulomb", "ticks and coulomb"):
        assert (finer.outcome[variant][0] == DIES_OUT).all()


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


def test_zwidth_draws_its_figure(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = hapticd("map", "--zwidth", "omega", "--velocity", "2", "--set", "spring.velocity_periods=3", "--json")
    assert answer.code == 0
    assert (tmp_path / "zwidth.png").stat().st_size > 10_000
    assert answer.document["figure"] == "zwidth.png"
    assert answer.document["largest_calm"]["linear"]["stiffness"] > 0.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--zwidth", "re35", "--passivity"), "exclude each other"),
        (("--set", "spring.damping=1"), "--set changes the config of --zwidth"),
        (("--zwidth", "re35", "--velocity", "1", "--velocity", "2"), "takes one --velocity"),
        (("--zwidth", "re35", "--velocity", "0"), "above 0"),
        (("--passivity", "--dask", "tcp://nowhere:1"), "--dask is for the maps"),
    ],
)
def test_what_does_not_go_together_is_refused(hapticd: Run, words: tuple[str, ...], said: str) -> None:
    answer = hapticd("map", *words)
    assert answer.code == 2
    assert said in answer.err


def test_check_prints_the_bound_and_runs_the_exact_loop(hapticd: Run) -> None:
    case = ("--set", "servo.rate_hz=100", "--set", "encoder.decimation=217", "--deflection", "10.3")
    assert hapticd("check", *case).code == 1
    answer = hapticd("check", *case, "--set", "spring.damping=3e-4", "--json")
    assert answer.code == 0
    damping = answer.document["damping"]
    assert damping["beta_v"] == pytest.approx(2.5)
    least = 0.012e-2 * float(lambda_(answer.document["tau_d"], 2.5))
    assert damping["passive"]["viscous_least"] == pytest.approx(least)
    assert not damping["passive"]["holds"]
    assert damping["exact"][0]["outcome"] in ("monotone", "decaying")
