from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import linalg

from hapticd.figures.files import save_figure
from hapticd.stability import map_engines, map_report, map_store, sampled_loop
from hapticd.stability.criterion import criterion_margin
from hapticd.stability.escape import escape, linear_loop
from hapticd.stability.figures.map import boundaries, draw
from hapticd.stability.maps import Chunk, Maps, Study, chunks, run_points
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.outcome import GROWING, OUTCOMES, PERSISTENT
from hapticd.stability.regions import region
from hapticd.stability.storage import velocity_bound

from .locked_cycle import locked_cycles
from .motion import simulate

COARSE = Study(beta_count=12, sigma_count=9, periods=20_000)


def computed(study: Study) -> Maps:
    maps = Maps(study)
    map_store.fill(maps, map_engines.local, None)
    return maps


@pytest.fixture(scope="module")
def eight_maps() -> Maps:
    return computed(Study())


@settings(max_examples=60, deadline=None)
@given(
    st.floats(1.0, 1e3), st.floats(0.0, 2.0), st.floats(0.0, 3.0), st.sampled_from([0.0, 0.25, 1.0, 1.25, 2.5]),
    st.floats(-20.0, 20.0),
)  # fmt: skip
@example(mu=620.0, beta=0.0, sigma=2.0, tau_d=0.25, velocity=0.328125)  # on its way to rest at the horizon
def test_a_run_is_bit_for_bit_the_plants(mu: float, beta: float, sigma: float, tau_d: float, velocity: float) -> None:
    device = Dimensionless(mu, beta, sigma, tau_d)
    reference = simulate(device, 0.0, velocity, 200, limit=math.inf)
    one = (np.array([beta]), np.array([sigma]), tau_d, np.array([velocity]))
    (point,) = run_points(mu, *one, 200, early=False)
    if point["reason"] == sampled_loop.HORIZON:
        assert (point["xi"], point["xi_dot"]) == reference.samples[-1]
    elif point["reason"] == sampled_loop.REST:
        resting = simulate(device, 0.0, velocity, 100_000, limit=math.inf).samples[-1]
        assert point["xi"] == pytest.approx(resting[0], abs=1e-9)


def test_ending_early_changes_no_outcome() -> None:
    compared = 0
    spent = np.zeros(2, np.int64)
    for d, tau_d in enumerate(COARSE.delays):
        beta, sigma = (a.ravel() for a in np.meshgrid(COARSE.betas(tau_d), COARSE.sigmas, indexing="ij"))
        for velocity in COARSE.velocities:
            start = np.full(beta.size, velocity)
            short = run_points(COARSE.mu, beta, sigma, tau_d, start, COARSE.periods)
            full = run_points(COARSE.mu, beta, sigma, tau_d, start, COARSE.periods, early=False)
            np.testing.assert_array_equal(short["outcome"], full["outcome"], err_msg=f"{d} {velocity}")
            moving = full["reason"] != sampled_loop.REST
            spent += short["periods"][moving].sum(), full["periods"][moving].sum()
            compared += beta.size
    assert compared == COARSE.size
    assert spent[0] < 0.5 * spent[1]


@pytest.mark.parametrize("periods", [3_000, 12_000])
def test_twice_the_horizon_changes_at_most_one_point_in_a_hundred(periods: int) -> None:
    short, long = (computed(Study(periods=n)).points["outcome"] for n in (periods, 2 * periods))
    assert np.mean(short != long) <= 0.01


def test_the_eight_maps_agree_with_theory(eight_maps: Maps) -> None:
    report = map_report.report(eight_maps)
    assert report["done"] == report["points"] == 8 * 714
    assert report["holds"]
    assert report["exceptions"] == []
    for name in ("A", "E", "F1", "F2"):
        entry = report["regions"].get(name, {"points": 0, "persistent": 0, "growing": 0})
        assert entry["points"] > 200 or name == "F2"  # what is left between ½ + τ_D and λ
        assert entry["persistent"] == entry["growing"] == 0
    assert report["regions"]["B"]["growing"] == 0
    assert report["regions"]["B"]["amplitude"]["max"] < 1.0
    assert report["b_one_tick"] == []


def test_regions_of_a_map_are_those_of_its_points(eight_maps: Maps) -> None:
    study = eight_maps.study
    for d, tau_d in enumerate(study.delays):
        for v, velocity in enumerate(study.velocities):
            bound = float(velocity_bound(0.0, velocity, study.mu, tau_d))
            names = map_report.regions_of(eight_maps, d, v)
            for i, beta in enumerate(study.betas(tau_d).tolist()):
                for j, sigma in enumerate(study.sigmas.tolist()):
                    assert names[i, j] == region(Dimensionless(study.mu, beta, sigma, tau_d), bound)


def test_energy_falls_all_the_time_from_sigma_one_on_in_a(eight_maps: Maps) -> None:
    study = eight_maps.study
    inside = np.ix_([0], range(4), study.betas(0.0) >= 0.5, study.sigmas >= 1.0)
    assert (eight_maps.points["outcome"][inside] == OUTCOMES.index("monotone")).all()
    between = np.ix_([0], range(4), study.betas(0.0) >= 0.5, (study.sigmas > 0.5) & (study.sigmas < 1.0))
    assert (eight_maps.points["outcome"][between] == OUTCOMES.index("decaying")).mean() > 0.3


def test_the_edge_of_b_oscillates_above_one_tick_and_is_listed() -> None:
    # the corner of the grid is β = 0.505, σ = 0 of the reading notes, but for a σ that changes nothing
    study = Study(delays=(0.0,), velocities=(1.0, 5.0), beta_count=1, beta_max=0.505, sigma_count=1, sigma_max=1e-12)
    report = map_report.report(computed(study))
    assert [row["outcome"] for row in report["b_one_tick"]] == ["persistent", "persistent"]
    assert [row["amplitude_ticks"] for row in report["b_one_tick"]] == pytest.approx([8.7, 32.0], rel=0.03)
    assert report["holds"]


@pytest.mark.parametrize(
    ("mu", "beta", "tau_d"), [(100.0, 0.3, 0.0), (5.0, 0.0, 0.7), (30.0, 1.2, 2.25), (2.0, 0.1, 1.0)]
)
def test_linear_loop_is_the_matrix_exponential(mu: float, beta: float, tau_d: float) -> None:
    A, b = linear_loop(mu, beta, tau_d)
    motion = np.array([[0.0, 1.0, 0.0], [0.0, -beta / mu, 1.0 / mu], [0.0, 0.0, 0.0]])
    whole = math.floor(tau_d)
    z = np.random.default_rng(3).normal(size=len(b))
    q = 0.4
    commands = [*z[2:], -z[0] + q]
    state = z[:2]
    for force, duration in ((commands[0], tau_d - whole), (commands[1], 1.0 - tau_d + whole)):
        state = (linalg.expm(motion * duration) @ [*state, force])[:2]
    np.testing.assert_allclose(A @ z + b * q, [*state, *commands[1:]], rtol=1e-12, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(2.0, 200.0), st.floats(0.0, 1.5), st.floats(0.0, 3.0), st.sampled_from([0.0, 0.5, 1.25]), st.floats(0.1, 50.0)
)  # fmt: skip
def test_the_bound_behind_certain_growth_holds_along_a_run(
    mu: float, beta: float, sigma: float, tau_d: float, velocity: float
) -> None:
    loop = escape(mu, beta, tau_d)
    loss = 0.5 * loop.command + sigma * loop.friction
    run = simulate(Dimensionless(mu, beta, sigma, tau_d), 0.0, velocity, 300)
    pending = math.floor(tau_d) + 1
    w = loop.real + 1j * loop.imaginary
    commands = [0.0] * pending + [-math.floor(xi) - 0.5 for xi, _ in run.samples]
    size = np.array([abs(w @ [*run.samples[h], *commands[h : h + pending]]) for h in range(len(run.samples))])
    assert (size[1:] >= (loop.gain * size[:-1] - loss) * (1.0 - 1e-9) - 1e-9).all()


def test_certain_growth_comes_true() -> None:
    beta, sigma = np.full(9, 0.3), np.linspace(0.2, 2.0, 9)
    start = np.full(9, 30.0)
    early = run_points(100.0, beta, sigma, 0.0, start, 100_000)
    full = run_points(100.0, beta, sigma, 0.0, start, 100_000, early=False)
    assert (early["reason"] == sampled_loop.ESCAPED).all()
    assert (full["reason"] == sampled_loop.LEFT).all()
    assert (early["outcome"] == GROWING).all()
    assert (early["periods"] < full["periods"]).all()


def test_a_recurrence_recurs() -> None:
    numbers = Dimensionless(100.0, 0.75, 0.2)
    (point,) = run_points(100.0, np.array([0.75]), np.array([0.2]), 0.0, np.array([0.05]), 50_000)
    assert (point["reason"], point["outcome"]) == (sampled_loop.RECURRED, PERSISTENT)
    again = simulate(numbers, float(point["xi"]), float(point["xi_dot"]), int(point["cycle"]))
    assert again.samples[-1] == (point["xi"], point["xi_dot"])


@pytest.mark.parametrize(("sigma", "velocity"), [(0.0, 0.05), (0.1, 0.05), (0.2, 0.05), (0.4, 0.05)])
def test_amplitude_and_frequency_are_those_of_an_exact_cycle(sigma: float, velocity: float) -> None:
    (point,) = run_points(100.0, np.array([0.75]), np.array([sigma]), 0.0, np.array([velocity]), 60_000)
    near = [
        c for c in locked_cycles(Dimensionless(100.0, 0.75, sigma)) if c.omega == pytest.approx(float(point["omega"]))
    ]
    assert [cycle.amplitude for cycle in near] == pytest.approx([float(point["amplitude"])], rel=1e-6)


def test_sliding_to_rest_without_net_force_is_rest() -> None:
    # σ = ½ holds the force of the first tick exactly: velocity decays by viscous friction alone, for ever
    (point,) = run_points(20.0, np.array([0.6]), np.array([0.5]), 0.0, np.array([-0.024]), 50_000, xi=np.array([0.9]))
    assert point["reason"] == sampled_loop.REST
    assert point["amplitude"] == 0.0
    assert 0.0 < point["xi"] < 0.9


def test_an_interrupted_study_goes_on_where_it_was(tmp_path: Path) -> None:
    study, path = Study(periods=500), tmp_path / "maps.npz"
    asked: list[int] = []

    def engine(wanted: list[Chunk]) -> map_engines.Results:
        asked.append(len(wanted))
        for k, result in enumerate(map_engines.local(wanted, 2)):
            if len(asked) == 1 and k == 5:
                raise KeyboardInterrupt
            yield result

    with pytest.raises(KeyboardInterrupt):
        map_store.fill(map_store.begin(path, study), engine, path)
    kept = map_store.begin(path, study)
    assert kept.done.any()
    assert not kept.done.all()
    map_store.fill(kept, engine, path)
    assert asked == [len(chunks(study)), len(chunks(study)) - 5]
    stored, whole = map_store.load(path), computed(study)
    assert stored.study == study
    assert stored.done.all()
    np.testing.assert_array_equal(stored.points, whole.points)
    map_store.fill(stored, engine, path)
    assert len(asked) == 2


def test_a_file_of_other_maps_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "maps.npz"
    map_store.save(path, Maps(Study(mu=50.0)))
    with pytest.raises(map_store.MapFileError, match=r"other options \(mu 50.0\)"):
        map_store.begin(path, Study())
    assert not map_store.begin(path, Study(), force=True).done.any()
    path.write_bytes(b"precious")
    with pytest.raises(map_store.MapFileError, match="not a file of region maps"):
        map_store.load(path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"mu": 0.0},
        {"delays": ()},
        {"velocities": (1.0, 1.0)},
        {"sigma_max": math.inf},
        {"periods": 3},
        {"beta_max": -1.0},
    ],
)
def test_a_study_that_cannot_be_made_names_what_is_wrong(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Study(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(("tau_d", "velocity"), [(0.0, 5.0), (1.25, 1.0), (1.25, 5.0)])
def test_the_lines_drawn_are_where_the_criterion_turns(tau_d: float, velocity: float) -> None:
    lines = boundaries(100.0, tau_d, velocity, np.linspace(0.0, 2.75, 12))
    bound = float(velocity_bound(0.0, velocity, 100.0, tau_d))
    for beta, sigma in lines["critical"].tolist():
        assert criterion_margin(Dimensionless(100.0, beta, sigma, tau_d), bound) == pytest.approx(0.0, abs=1e-9)
    assert lines["viscous"][0, 0] == 0.5 + tau_d
    assert lines["coulomb"][0, 1] == 0.5


def test_the_figure_shows_every_map(eight_maps: Maps, tmp_path: Path) -> None:
    figure = draw(eight_maps)
    assert len(figure.axes) == 8
    assert {text.get_text() for text in figure.axes[5].texts} - {"F2"} == {"B", "C", "D", "E", "F1"}
    save_figure(figure, tmp_path / "maps.png")
    assert (tmp_path / "maps.png").read_bytes().startswith(b"\x89PNG")


def test_an_oscillation_that_is_still_dying_down_is_marked() -> None:
    # β just above ½: from 500 ticks the motion needs far more than the horizon to reach its small cycle
    beta, sigma, start = np.array([0.5025, 0.75]), np.array([0.01, 0.2]), np.array([50.0, 50.0])
    far, near = run_points(100.0, beta, sigma, 0.0, start, 50_000)
    assert (far["outcome"], far["settled"], near["outcome"], near["settled"]) == (PERSISTENT, False, PERSISTENT, True)
    assert far["amplitude"] > 100.0
    assert near["amplitude"] < 0.05
