"""The benchmark of foreign records: its integrator against scipy's, what a file holds, how answers are judged, one case."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

from benchmarks.gap.foreign import __main__ as command
from benchmarks.gap.foreign import cases, judge, machines, nominal, record, table, truth
from benchmarks.gap.foreign.simulate import Loop, Machine, play
from hapticd.config import load_config
from hapticd.gap.data import load_recording
from hapticd.record import import_run, load_map, read_run

FREE = Loop(0.0, 0.0, 0.0, 0.0, 1e9, 1, 0)
TICK_S = 1e-3


def moved(machine: Machine, torque: np.ndarray[Any, Any], start: float = 0.0) -> Any:
    zero = np.zeros(torque.size)
    return play(machine, FREE, zero, torque, zero, TICK_S, start)


def test_a_pendulum_without_friction_keeps_its_energy_and_follows_solve_ivp() -> None:
    m = Machine(0.1, 0.0, 0.0, 1.0, 1e-4, 1e-3, gravity=2.0, hangs_at=0.3)
    found = moved(m, np.zeros(10_001), 2.3)
    t = np.arange(found.position.size) * TICK_S
    wanted = solve_ivp(
        lambda _, y: [y[1], -20.0 * math.sin(y[0] - 0.3)], (0, t[-1]), [2.3, 0.0], t_eval=t, rtol=1e-11, atol=1e-12
    )
    energy = 0.05 * found.velocity**2 - 2.0 * np.cos(found.position - 0.3)
    assert np.ptp(energy) < 1e-4
    assert np.abs(found.position - wanted.y[0]).max() < 1e-3


def test_bristles_and_bent_friction_follow_solve_ivp() -> None:
    m = Machine(
        0.02,
        0.1,
        0.5,
        1.0,
        1e-4,
        5e-3,
        bristle_damping=0.5,
        stribeck=0.6,
        stribeck_speed=0.3,
        exponent=0.5,
        bend_speed=0.4,
    )
    t = np.arange(4001) * TICK_S
    found = moved(m, 1.2 * np.sin(2.0 * np.pi * np.floor(t / TICK_S + 0.5) * TICK_S))

    def rates(at: float, y: np.ndarray[Any, Any]) -> list[float]:
        _, v, z = y
        slips = v - 100.0 * abs(v) * z / (0.5 * (1.0 + 0.6 * math.exp(-((v / 0.3) ** 2))))
        drag = 0.1 * v / math.sqrt(1.0 + abs(v) / 0.4)
        torque = 1.2 * math.sin(2.0 * np.pi * at)
        return [v, (torque - drag - 100.0 * z - 0.5 * slips) / 0.02, slips]

    wanted = solve_ivp(rates, (0, t[-1]), [0.0, 0.0, 0.0], "LSODA", t_eval=t, rtol=1e-9, atol=1e-12)
    # The torque is held over a tick: on average it is half a tick late.
    late = np.interp(t - 0.5 * TICK_S, t, wanted.y[0])
    assert np.ptp(wanted.y[0]) > 1.0
    assert np.abs(found.position - late).max() < 2e-3 * np.ptp(wanted.y[0])


def test_current_loop_delay_and_report() -> None:
    m = Machine(1.0, 1.0, 0.0, 2.0, 1e-4, 1e-3, current_lag_s=0.02, report_lag_s=0.05)
    loop = FREE._replace(delay=10)
    zero = np.zeros(400)
    found = play(m, loop, zero, np.full(400, 4.0), zero, TICK_S)
    t = np.arange(400) * TICK_S - 0.01
    after = np.where(t > 0.0, 2.0 * (1.0 - np.exp(-t / 0.02)), 0.0)
    assert found.command == pytest.approx(np.full(400, 2.0))
    assert found.current == pytest.approx(after, abs=1e-6)
    reported = 2.0 * (1.0 - (0.05 * np.exp(-t / 0.05) - 0.02 * np.exp(-t / 0.02)) / 0.03)
    assert found.reported == pytest.approx(np.where(t > 0.0, reported, 0.0), abs=5e-3)


def test_a_seed_has_all_machines_frictions_and_faults_and_is_the_same_again() -> None:
    drawn = [cases.Case(3, number).drawn for number in range(120)]
    assert {each[0] for each in drawn} == set(machines.MACHINES)
    assert {each[1] for each in drawn} == set(machines.FRICTIONS)
    assert {each[2] for each in drawn} == set(record.FAULTS)
    assert cases.make(cases.Case(3, 2)) == cases.make(cases.Case(3, 2))
    assert cases.make(cases.Case(3, 2))[0] != cases.make(cases.Case(4, 2))[0]


@pytest.mark.parametrize("number", range(10))
def test_a_record_is_imported_as_the_machine_moved(number: int, tmp_path: Path) -> None:
    files, known = cases.make(cases.Case(0, number))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        assert known["friction"].encode() not in content
    imported = import_run(tmp_path / "record.csv", load_map(tmp_path / "map.yaml"), tmp_path / "run.arrow")
    model = load_config(tmp_path / "model.yaml")
    columns = read_run(tmp_path / "run.arrow").columns
    assert imported.rows == known["rows"]
    assert imported.resolution == pytest.approx(known["device"]["resolution"])
    assert np.ptp(columns["encoder_counts"]) > 200
    assert model.plant.inertia == pytest.approx(known["said"]["inertia"], rel=1e-3)
    assert known["said"]["inertia"] != known["true"]["inertia"]


def test_what_is_wrong_with_a_record() -> None:
    rng = np.random.default_rng(1)
    plain = machines.position_axis("straight", rng)
    plain = plain._replace(rate_hz=1000.0, tick_s=5e-4, loop=plain.loop._replace(every=2))
    seen = {}
    for fault in record.FAULTS:
        drawn = record.broken(plain, fault, np.random.default_rng(2))
        sent = (drawn.machine, drawn.loop, drawn.reference, drawn.feed, drawn.disturbance, drawn.tick_s)
        motion = play(*sent)
        seen[fault] = drawn, motion, record.recorded(drawn, motion, fault, np.random.default_rng(3))
    drawn, motion, rows = seen["none"]
    assert rows.current == pytest.approx(motion.command[6::2][: rows.current.size])
    assert rows.position == pytest.approx(
        np.floor(motion.position[6::2] / drawn.machine.resolution)[: rows.position.size]
    )
    assert np.all(np.abs(np.diff(rows.stamp) - 1e-3) < 1e-9)
    rounded = seen["rounded_stamps"][2].stamp * 1e3
    assert rounded == pytest.approx(np.rint(rounded))
    assert set(np.rint(np.diff(rounded))) == {1.0, 2.0}
    assert np.unique(np.round(np.diff(seen["few_digits"][2].stamp), 9)).size < 20
    assert np.std(np.diff(seen["uneven"][2].stamp)) > 2e-5
    assert seen["sampled"][0].loop.every == 1
    _, motion, rows = seen["filtered_current"]
    assert np.std(rows.current) < np.std(motion.current)
    drawn, motion, rows = seen["stale"]
    now = motion.position[6::2][: rows.position.size] / drawn.machine.resolution
    behind = np.median((now - rows.position - 0.5)[np.diff(now, prepend=now[0]) > 0.5 * np.diff(now).max()])
    assert behind > 0.3 * np.diff(now).max()


def test_the_straight_base_is_the_machine_s_own_where_friction_is_straight() -> None:
    drawn = machines.robot_joint("straight", np.random.default_rng(4))
    machine = drawn.machine._replace(gravity=0.0)
    motion = play(machine, drawn.loop, drawn.reference, drawn.feed, 0.0 * drawn.disturbance, drawn.tick_s, drawn.start)
    base = nominal.straight(drawn, motion)
    assert base == pytest.approx((machine.inertia, machine.viscous, machine.coulomb), rel=1e-6)
    lacks = nominal.shares(drawn, motion, base, base._replace(inertia=2.0 * base.inertia))
    assert lacks["base_lacks"] < 0.1
    assert lacks["config_lacks"] == pytest.approx(lacks["inertial"], rel=0.1)


KNOWN = {
    "friction": "degressive",
    "config_lacks": 0.4,
    "right": ["quadratic_drag", "stribeck", "torque_ripple"],
    "near": ["presliding"],
    "signs": truth.SIGNS["degressive"],
    "orders": [7.0],
    "friction_is_free": True,
    "true": {"inertia": 1.0, "viscous": 1.0, "coulomb": 1.0},
    "said": {"inertia": 1.1, "viscous": 1.0, "coulomb": 1.0},
}


def told(verdict: str, *steps: tuple[str, dict[str, float], list[str]], **more: Any) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "statement": "",
        "effects": [name for name, *_ in steps],
        "steps": [
            {
                "effect": name,
                "parameters": {key: {"value": value} for key, value in values.items()},
                "indistinguishable_from": ties,
            }
            for name, values, ties in steps
        ],
        "base": {},
        "details": {"at_bounds": {}, "predicted_better_by": {}},
        **more,
    }


DRAG = ("quadratic_drag", {"d": -0.1}, [])


@pytest.mark.parametrize(
    ("answer", "wanted"),
    [
        (told("effect_found", DRAG), "right"),
        (told("effect_found", ("quadratic_drag", {"d": 0.1}, [])), "wrong"),
        (told("effect_found", ("stribeck", {"s": -0.4, "omega_s": 1.0}, [])), "right"),
        (told("partly_explained", DRAG, ("backlash", {}, [])), "wrong"),
        (told("ambiguous", ("backlash", {}, ["quadratic_drag"])), "abstains"),
        (told("ambiguous", ("backlash", {}, ["torque_ripple"])), "abstains"),
        (told("ambiguous", ("backlash", {}, ["gravity"])), "doubted"),
        (told("effect_found", ("presliding", {}, [])), "wrong"),
        (told("ambiguous", ("presliding", {}, ["backlash"])), "abstains"),
        (told("effect_found", ("torque_ripple", {"orders[0]": 7.02}, [])), "right"),
        (told("effect_found", ("torque_ripple", {"orders[0]": 5.0}, [])), "wrong"),
        (told("effect_found", ("inertia_error", {}, []), base={"inertia": {"value": 1.05}}), "right"),
        (told("effect_found", ("inertia_error", {}, []), base={"inertia": {"value": 1.15}}), "wrong"),
        (told("effect_found", ("torque_constant_error", {"r": 0.1}, [])), "right"),
        (told("effect_found", DRAG, base={"inertia": {"value": 1.3}}), "missed"),
        (told("partly_explained", DRAG, base={"inertia": {"value": 1.3}}), "abstains"),
        (told("no_missing_effect"), "missed"),
        (told("unexplained"), "abstains"),
        ({"error": "ValueError"}, "failed"),
    ],
)
def test_how_answers_are_judged(answer: dict[str, Any], wanted: str) -> None:
    assert judge.outcome(KNOWN, answer) == wanted


def test_doubt_makes_a_wrong_name_doubted() -> None:
    details = {"at_bounds": {"backlash": ["play"]}, "predicted_better_by": {}}
    assert judge.outcome(KNOWN, told("partly_explained", ("backlash", {}, []), details=details)) == "doubted"
    assert judge.outcome({**KNOWN, "config_lacks": 0.01}, told("no_missing_effect")) == "right"


def test_it_runs_goes_on_and_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["-o", str(tmp_path), "--seed", "19", "--cases", "1", "--jobs", "1"]
    assert command.main([*given, "--report"]) == 1
    assert command.main(given) == 0
    text = capsys.readouterr().out
    assert "1 of 1 cases answered" in text
    assert "right or abstains" in text
    path = tmp_path / table.WHO / "s019-000.json"
    kept = path.read_bytes()
    answer = json.loads(kept)
    assert "error" not in answer
    assert answer["details"]["filter_runs"] > 0
    assert yaml.safe_load((tmp_path / "cases/s019-000/map.yaml").read_text())["device"] == "rotary"
    assert command.main(given) == 0
    assert path.read_bytes() == kept


def test_a_clock_of_the_device_is_found_where_it_has_one_and_nowhere_else(tmp_path: Path) -> None:
    has: list[bool] = []
    found: list[bool] = []
    own = [number for number in range(120) if cases.Case(0, number).drawn[2] == "unsynchronised"]
    for number in {*own, *range(20)}:
        files, known = cases.make(cases.Case(0, number))
        for name, content in files.items():
            (tmp_path / name).write_bytes(content)
        import_run(tmp_path / "record.csv", load_map(tmp_path / "map.yaml"), tmp_path / f"{number}.arrow")
        recording = load_recording(tmp_path / f"{number}.arrow", load_config(tmp_path / "model.yaml"))
        has.append(known["fault"] == "unsynchronised")
        found.append(any("a clock of their own" in warning for warning in recording.warnings))
    assert not any(clock and not one for clock, one in zip(found, has, strict=True))
    assert sum(found) > 0.8 * len(own) > 5.0  # a beat that is nearly as slow as the motion is not found


def test_cases_of_one_fault(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        command.parse(["--fault", "broken"])
    assert "unsynchronised" in capsys.readouterr().err
    asked: list[cases.Case] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command.options, "answer_and_report", lambda _, wanted, *__: asked.extend(wanted) or 0)
        assert (
            command.main(["--seed", "3", "--cases", "60", "--fault", "stale", "--fault", "none", "-o", str(tmp_path)])
            == 0
        )
    assert len(asked) > 5
    assert {case.drawn[2] for case in asked} == {"stale", "none"}
