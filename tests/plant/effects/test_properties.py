"""What holds for every effect: neutral is absent to the bit, no parameters break it, and passive ones give no energy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.config import load_config
from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant.exact import propagate
from hapticd.plant.layout import NAMES, OMEGA, SIZE, STATE, device_vector, index_of, initial_state, neutral_vector
from hapticd.plant.numeric import measured, simulate_windows_serial
from tests.plant.effects.independent import KT, PERIOD, B, C, J, excitation, motor_current, simulated, times, vector


def test_without_effects_it_is_the_exact_plant_to_the_bit() -> None:
    currents = excitation(300)
    x = v = 0.0
    expected = []
    t = times(len(currents))
    for k, current in enumerate(currents):
        x, v = propagate(x, v, t[k + 1] - t[k], current * KT, J, B, C)
        expected.append(x)
    got, end = simulated(vector(), currents)
    assert np.array_equal(got, expected)
    assert end[OMEGA] == v


@pytest.mark.parametrize("slug", CATALOGUE)
def test_neutral_magnitudes_switch_an_effect_off_whatever_its_shape(slug: str) -> None:
    """The first parameters at their neutral value, all others anywhere: the base result, to the bit."""
    currents = excitation(60)
    magnitudes = {"torque_ripple": ("orders", "amplitudes"), "hand_impedance": ("m_h", "b_h", "k_h")}
    off = magnitudes.get(slug, (CATALOGUE[slug].parameters[0].name,))
    p = vector()
    for parameter in CATALOGUE[slug].parameters:
        if parameter.name not in off and slug != "presliding":
            first = index_of(f"{slug}.{parameter.name}")
            p[first : first + parameter.length] = 0.5 * (parameter.lower + parameter.upper)
    base, _ = simulated(vector(), currents)
    got, _ = simulated(p, currents)
    assert np.array_equal(got, base)
    assert measured(p, 1.2345) == 1.2345


def test_the_vector_names_every_word_once() -> None:
    assert len(set(NAMES)) == SIZE == len(neutral_vector())
    assert index_of("torque_ripple.amplitudes") == index_of("torque_ripple.amplitudes[0]")
    with pytest.raises(KeyError):
        index_of("stribeck.omega")
    config = load_config(None)
    assert device_vector(config, 2e-4)[index_of("delay_s")] == config.amplifier.delay + 2e-4


def test_windows_do_not_depend_on_each_other() -> None:
    p = vector(stribeck__s=0.4, stribeck__omega_s=3.0, gravity__m_g_l=1e-3, amplifier_lag__f_a=300.0)
    currents = excitation(200)
    drive = motor_current(p, currents, 2)
    t = times(199)
    start = np.arange(0, 190, 10)
    states = np.array([initial_state(0.01 * k, 0.1 * k) for k in range(len(start))])
    positions, ends = np.empty((len(start), 9)), np.empty((len(start), STATE))
    simulate_windows_serial(p, t, drive, start, 9, states, positions, ends)
    for k in reversed(range(len(start))):
        position, end = np.empty((1, 9)), np.empty((1, STATE))
        one = slice(k, k + 1)
        simulate_windows_serial(p, t, drive, start[one], 9, states[one], position, end)
        assert np.array_equal(position[0], positions[k])
        assert np.array_equal(end[0], ends[k])
    alone, _ = simulated(p, currents)
    assert alone.shape == (200,)


def _values(slug: str) -> st.SearchStrategy[dict[str, Any]]:
    fields = {}
    for p in CATALOGUE[slug].parameters:
        number = st.floats(p.lower, p.upper)
        if p.scale == "log" and p.upper > 0:
            low = math.log(max(p.lower, 1e-9))
            number = st.one_of(
                number,
                st.floats(low, math.log(p.upper)).map(math.exp).map(lambda v, p=p: min(max(v, p.lower), p.upper)),
            )
        fields[p.name] = number if p.length == 1 else st.lists(number, min_size=p.length, max_size=p.length)
    return st.fixed_dictionaries(fields)


@pytest.mark.parametrize("slug", CATALOGUE)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_parameters_within_their_bounds_break_it(slug: str, data: st.DataObject) -> None:
    values = data.draw(_values(slug))
    p = vector(**{f"{slug}__{name}": value for name, value in values.items()})
    state = initial_state(data.draw(st.floats(-10, 10)), data.draw(st.floats(-300, 300)))
    positions, end = simulated(p, excitation(25, seed=data.draw(st.integers(0, 100))), state)
    assert np.isfinite(positions).all()
    assert np.isfinite(end).all()


PASSIVE = {
    "stribeck": {"s": 2.0, "omega_s": 1.0},
    "quadratic_drag": {"d": -1e-6},
    "asymmetric_viscous": {"a": 0.9},
    "load_dependent_friction": {"kappa": 0.5},
    "thermal_drift": {"r": 3.0, "t_w": 0.01},
    "viscous_friction": {"r": 20.0},
}


@pytest.mark.parametrize("slug", PASSIVE)
def test_friction_never_gives_energy(slug: str) -> None:
    p = vector(**{f"{slug}__{name}": value for name, value in PASSIVE[slug].items()})
    for speed in (0.5, 5.0, -60.0):
        state = initial_state(0.0, speed)
        before = abs(speed)
        for _ in range(40):
            _, state = simulated(p, np.zeros(1), state)
            assert abs(state[OMEGA]) <= before
            before = abs(state[OMEGA])


@pytest.mark.parametrize(
    ("changes", "potential"),
    [
        ({"gravity__m_g_l": 5e-3}, lambda x: -5e-3 * math.cos(x)),
        ({"torque_ripple__orders": [6], "torque_ripple__amplitudes": [1e-3]}, lambda x: 1e-3 / 6 * math.cos(6 * x)),
        ({"return_spring__k_s": 0.02}, lambda x: 0.01 * x * x),
    ],
)
def test_a_field_gives_back_what_it_took(changes: dict[str, Any], potential: Any) -> None:
    p = vector(coulomb=0.0, viscous=0.0, **changes)
    state = initial_state(1.0, 8.0)
    energy = 0.5 * J * 64.0 + potential(1.0)
    for _ in range(100):
        _, state = simulated(p, np.zeros(3), state, substeps=4)
        assert 0.5 * J * state[OMEGA] ** 2 + potential(state[0]) == pytest.approx(energy, abs=2e-3 * abs(energy))


def test_the_instant_of_a_stop_is_exact_whatever_the_step() -> None:
    for speed in (0.05, 0.31, 2.2):
        stop = J / B * math.log1p(B * speed / C)
        rest = J / B * (speed - C / B * math.log1p(B * speed / C))
        positions, end = simulated(vector(presliding__breakaway=0.0), np.zeros(10), initial_state(0.0, speed))
        assert positions[-1] == pytest.approx(rest, rel=1e-11)
        assert end[OMEGA] == 0.0
        moving = np.count_nonzero(np.diff(positions)) + 1
        assert moving == math.ceil(stop / PERIOD) or moving == math.ceil(stop / PERIOD) + 1
