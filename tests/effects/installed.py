"""What the process does in which effects from outside are installed: run by `test_from_outside` as tests of their own."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from hapticd.cli.main import build_app
from hapticd.config import EFFECT_SLUGS, ConfigError, config_schema, parse_config, parse_yaml
from hapticd.effects.catalogue import BROKEN, CATALOGUE, HOOK_ROOM, OWN_SLUGS
from hapticd.effects.pages import page
from hapticd.gap import find_gap
from hapticd.plant import kernel
from hapticd.plant.layout import HOOKS, NAMES, SIZE, device_vector, index_of, neutral_vector
from hapticd.plant.resolution import substeps_for
from hapticd.servo.simulate import simulate
from hapticd.stability.cautions import uncounted
from hapticd.stability.numbers import loop_from_config
from tests.gap import synthetic
from tests.plant.effects.independent import C, Laws, apart, excitation, simulated, vector
from tests.plant.effects.test_closed_loop import config_with, driven
from tests.sim_hw.boards import rows, running_board
from tests.sim_hw.host import Host

DETENT = {"a": 3e-3, "theta_0": 0.2, "w": 0.15}
GREASE = {"a": 0.8, "t_d": 0.1, "v": 8.0}
LISTED = {"name": "magnetic_detent", **DETENT}


def of(slug: str, values: dict[str, float]) -> Any:
    return vector(**{f"{slug}__{name}": value for name, value in values.items()})


def detent(x: float) -> float:
    u = (x - DETENT["theta_0"]) / DETENT["w"]
    return -DETENT["a"] * u * math.exp((1 - u * u) / 2)


def test_the_catalogue_has_them_after_its_own() -> None:
    assert list(EFFECT_SLUGS) == [*OWN_SLUGS, "drying_grease", "magnetic_detent", "uncompilable"]
    assert "drying_grease" in CATALOGUE["thermal_drift"].equivalent_to
    assert HOOKS + HOOK_ROOM == SIZE == len(set(NAMES))


def test_the_config_knows_its_parameters() -> None:
    assert parse_config({"plant": {"effects": [LISTED]}}, "x").plant.effects[0].name == "magnetic_detent"
    assert "magnetic_detent" in config_schema()["$defs"]["Effect"]["properties"]["name"]["enum"]
    with pytest.raises(ConfigError) as raised:
        parse_config({"plant": {"effects": [{"name": "magnetic_detent", "a": -1, "theta": 2}]}}, "x")
    assert str(raised.value).splitlines() == [
        "x: plant.effects[0].a = -1: must be at least 0 N m (N on a linear device)",
        "x: plant.effects[0].theta: unknown parameter of magnetic_detent; did you mean theta_0?",
        "x: plant.effects[0].w: is missing; magnetic_detent needs a, w",
    ]


@pytest.mark.parametrize(
    ("slug", "reason"),
    [
        ("absent", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("number", "is not a hapticd.effects.Effect but int"),
        ("misnamed", "the effect's slug is drying_grease"),
        ("nameless_relation", "it refers to nobody, which the catalogue does not have"),
        ("lawless", "it has neither a force nor a friction"),
        ("misplaced", "acts_on is 'input'; an effect of another package must have a force or a friction"),
        ("short", "friction must take 3 numbers and the 3 of its parameters"),
        ("lengthy", "it has 57 parameters; there is room for 52 more of effects of other packages"),
    ],
)
def test_one_that_cannot_be_used_says_why_and_which_entry_point_it_is(slug: str, reason: str) -> None:
    with pytest.raises(ConfigError) as raised:
        parse_config({"plant": {"effects": [{"name": slug, "a": 1}]}}, "x")
    text = str(raised.value)
    assert text.startswith(f"x: plant.effects[0].name = {slug}: cannot be used: entry point {slug} = ")
    assert "of outside-effects" in text
    assert reason in text


def test_one_that_cannot_be_compiled_stops_only_a_device_that_has_it() -> None:
    config = parse_config({"plant": {"effects": [{"name": "uncompilable", "a": 1.0}]}}, "x")
    with pytest.raises(ConfigError, match=r"plant\.effects\[0\]\.name = uncompilable: its law cannot be compiled: "):
        device_vector(config)
    assert neutral_vector()[index_of("uncompilable:friction")] == 0.0


def test_one_cannot_take_the_name_of_another() -> None:
    assert "already has an effect of that name" in BROKEN["stribeck"]
    assert CATALOGUE["stribeck"].law.startswith("c → c (1 + s")


def test_a_record_s_kernels_follow_its_force() -> None:
    currents = excitation(200)
    expected = Laws(field=lambda x, current, t: detent(x)).run(currents)
    p = of("magnetic_detent", DETENT)
    got, _ = simulated(p, currents)
    assert apart(expected, simulated(vector(), currents)[0]) > 0.1
    assert apart(got, expected) < 5e-3
    assert substeps_for(p, 1e-3) == 1
    assert substeps_for(of("magnetic_detent", {"a": 0.05, "w": 0.01}), 1e-3) == 3


def test_a_record_s_kernels_follow_its_friction() -> None:
    currents = excitation(200)

    def level(speed: float, current: float, t: float) -> float:
        return C + GREASE["a"] * 2e-3 * (1 - math.exp(-t / GREASE["t_d"])) * math.exp(-speed / GREASE["v"])

    expected = Laws(level=level).run(currents)
    got, _ = simulated(of("drying_grease", GREASE), currents)
    assert apart(expected, simulated(vector(), currents)[0]) > 0.1
    assert apart(got, expected) < 5e-3


def test_with_others_they_add_up() -> None:
    currents = excitation(100)
    both = {f"drying_grease__{name}": value for name, value in GREASE.items()}
    p = vector(**{f"magnetic_detent__{name}": value for name, value in DETENT.items()}, **both, return_spring__k_s=0.01)
    expected = Laws(
        field=lambda x, current, t: detent(x) - 0.01 * x,
        level=lambda speed, current, t: C + 1.6e-3 * (1 - math.exp(-t / 0.1)) * math.exp(-speed / 8.0),
    ).run(currents)
    got, _ = simulated(p, currents)
    assert apart(got, expected) < 5e-3


@pytest.mark.parametrize(("slug", "values"), [("magnetic_detent", DETENT), ("drying_grease", GREASE)])
def test_the_closed_loop_moves_as_the_kernels_of_a_record(slug: str, values: dict[str, float]) -> None:
    currents = excitation(150)
    expected, _ = simulated(of(slug, values), currents)
    assert np.abs(driven(config_with({"name": slug, **values}), currents) - expected).max() < 1e-10


@pytest.mark.parametrize(
    ("other", "values"),
    [("backlash", {"gap": 0.02}), ("flexible_coupling", {"f_r": 60.0}), ("presliding", {"breakaway": 2e-3})],
)
def test_they_act_on_devices_with_a_memory(other: str, values: dict[str, float]) -> None:
    currents = excitation(100)
    without, _ = simulated(of(other, values), currents)
    p = of(other, values)
    listed = vector(**{f"magnetic_detent__{name}": value for name, value in DETENT.items()})
    p = np.where(listed != vector(), listed, p)
    got, _ = simulated(p, currents)
    assert apart(got, without) > 0.05


def test_a_device_rests_where_they_hold_it() -> None:
    f = kernel.init_plant(config_with(LISTED), DETENT["theta_0"] + 0.01)
    assert kernel.plant_stays(f, f.view(np.int64))
    f = kernel.init_plant(config_with(LISTED), DETENT["theta_0"] + DETENT["w"])
    assert not kernel.plant_stays(f, f.view(np.int64))


def test_simulate_knows_it() -> None:
    config = config_with(LISTED, encoder={"decimation": 217})
    first, again = (simulate(config, 0.2, deflection=20.3)["final"] for _ in range(2))
    base = simulate(config_with(encoder={"decimation": 217}), 0.2, deflection=20.3)["final"]
    assert first == again != base


def test_check_counts_what_its_hook_says_and_names_the_others(tmp_path: Path) -> None:
    config = config_with(LISTED, {"name": "drying_grease", **GREASE})
    assert uncounted(config) == ("magnetic_detent",)
    assert loop_from_config(config) == loop_from_config(config_with())
    file = tmp_path / "lab.yaml"
    file.write_text(yaml.safe_dump({"plant": {"effects": [LISTED, {"name": "drying_grease", **GREASE}]}}))
    done = CliRunner().invoke(build_app(), ["check", str(file), "--deflection", "5", "--json"])
    (warning,) = [text for text in json.loads(done.stdout)["warnings"] if "plant.effects" in text]
    assert "(magnetic_detent)" in warning


PLANT = yaml.safe_dump({"plant": {"effects": [LISTED]}, "amplifier": {"bandwidth_hz": 500}})


def test_the_simulated_hardware_has_it(tmp_path: Path) -> None:
    """The commands of the board's log, put into a plant of the test's own, give the log's positions.

    Not to the bit: a law that is not exact is taken over steps, and the board's end at other instants too.
    """
    with running_board(tmp_path, plant=PLANT) as board:
        host = Host(board.link)
        host.begin(10_000)
        for tick in range(60):
            host.sample()
            host.command(8192 + (tick * 37) % 901 - 300, 1)
            time.sleep(0.001)
        host.sample()
        host.close()
        log = board.stop()
    config = parse_yaml(PLANT, "plant")
    bare = parse_yaml("amplifier: {bandwidth_hz: 500}", "plant")
    ends = []
    for device in (config, bare):
        f = kernel.init_plant(device)
        i = f.view(np.int64)
        i[kernel.TIME_NS] = log["time_ns"][0]
        for row in log:
            kernel.plant_advance(f, i, row["time_ns"], 0.0)
            if row["event"] == 2 and row["detail"] >> 8 == 1:
                kernel.plant_command(f, i, row["time_ns"], 0.0, row["command_A"])
            elif row["event"] == 1 and device is config:
                assert row["position"] == pytest.approx(f[kernel.POSITION], abs=1e-5)
        ends.append(f[kernel.POSITION])
    assert rows(log, "SAMPLE").size == 61
    assert abs(ends[0] - ends[1]) > 1e-3


@pytest.mark.timeout(700)  # where nothing is compiled yet
def test_the_gap_workflow_names_it() -> None:
    """Hidden by another integrator, in a motion that goes well beyond it."""
    size, place, width = 1.0e-3, 1.0, 2.0

    def hidden(angle: float, velocity: float, time: float) -> float:
        u = (angle - place) / width
        return -size * u * math.exp(0.5 * (1.0 - u * u))

    result = find_gap([synthetic.run(hidden, 10.0, 3)], synthetic.model(), design=False)
    assert result.effects[:1] == ("magnetic_detent",), result.statement
    found = result.steps[0].parameters
    assert found["a"].value == pytest.approx(size, rel=0.05)
    assert found["theta_0"].value == pytest.approx(place, abs=0.05)
    assert found["w"].value == pytest.approx(width, rel=0.05)
    assert result.gap.held_out_after < 0.3 * result.gap.held_out_before


def test_it_has_a_page() -> None:
    text = page(CATALOGUE["magnetic_detent"])
    assert "| `w` | rad | m | 1 | 1e-06 … 10 |" in text
    assert "[return_spring](return_spring.md)" in text
    example = yaml.safe_load(text.split("```yaml\n")[1].split("```")[0])
    assert parse_config(example, "page").plant.effects[0].name == "magnetic_detent"
