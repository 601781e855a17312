"""The steps of both proofs, one query each: z3 finds no real numbers that contradict them.

docs/explanation/stability.md has the same steps in words. The norm of the delayed form is no query over a few numbers: that
is in `test_theorem`.
"""

from __future__ import annotations

import pytest
import z3


def holds(claim: z3.BoolRef, *given: z3.BoolRef) -> bool:
    """Whether a claim follows, for all numbers, from what is given."""
    solver = z3.Solver()
    solver.set("timeout", 3_000)
    solver.add(*given, z3.Not(claim))
    return bool(solver.check() == z3.unsat)


def size(x: z3.ArithRef) -> z3.ArithRef:
    return z3.If(x >= 0, x, -x)


def clipped(x: z3.ArithRef, low: z3.ArithRef, high: z3.ArithRef) -> z3.ArithRef:
    return z3.If(x < low, low, z3.If(x > high, high, x))


mu, beta, sigma, kappa, q, e = z3.Reals("mu beta sigma kappa q e")
x, v, held, force, sign = z3.Reals("x v held force sign")


def test_a_query_that_is_false_is_not_proven() -> None:
    assert not holds(q * q >= q, q >= 0)


def test_the_balance_of_s() -> None:
    # μξ̈ = −ξ(h) + e − κξ − βξ̇ − σ sgn ξ̇ + φ_H; dS/dτ = μξ̇ξ̈ + (1 + κ)ξξ̇
    acceleration = -held + e - kappa * x - beta * v - sigma * sign + force
    power = v * acceleration + (1 + kappa) * x * v
    assert holds(power == force * v + (x - held) * v + e * v - beta * v * v - sigma * sign * v)
    D, d = z3.Reals("D d")
    # ∫(ξ − ξ(h))dξ from ξ(h) + d to ξ(h) + d + D
    assert holds(((d + D) * (d + D) - d * d) / 2 == D * D / 2 + d * D)


def test_theorem_1_is_one_query() -> None:
    """Within a period D = ξ(τ) − ξ(h); E = ∫ξ̇², A = ∫|ξ̇|, and W, the work of e, is within ±qA."""
    D, E, A, W, top = z3.Reals("D E A W top")
    change = D * D / 2 + W - beta * E - sigma * A
    given = [A >= 0, q * A >= W, D * D <= E, E >= 0, top * A >= E, top >= 0, sigma >= q]
    assert holds(change <= 0, *given, (beta - z3.Q(1, 2)) * top + sigma - q >= 0)
    assert holds(change <= 0, *given[:4], sigma >= q, beta >= z3.Q(1, 2))  # whatever the speed
    # and not with less of either
    assert not holds(change <= 0, *given, (beta - z3.Q(1, 2)) * top + sigma - q >= -z3.Q(1, 100))


def test_theorem_2_is_the_same_query_with_lambda() -> None:
    lam, form, E, A, W, top = z3.Reals("lam form E A W top")
    change = form + W - beta * E - sigma * A
    given = [A >= 0, q * A >= W, form <= lam * E, E >= 0, top * A >= E, top >= 0, sigma >= q]
    assert holds(change <= 0, *given, (beta - lam) * top + sigma - q >= 0)


def test_lambda_is_the_larger_eigenvalue_of_the_form_at_zero_frequency() -> None:
    # (½ + m)ssᵀ + ½(usᵀ + suᵀ), s = (r, t), u = (r, 0), r² = f, t² = 1 − f
    r, t, m, lam, a, b, c, y, z = z3.Reals("r t m lam a b c y z")
    k = z3.Q(1, 2) + m
    first, last, mixed = k * r * r + r * r, k * t * t, k * r * t + r * t / 2
    unit = r * r + t * t == 1
    assert holds(first + last == k + r * r, unit)
    assert holds(first * last - mixed * mixed == -r * r * t * t / 4, unit)
    # so λ² − (½ + τ_D)λ − f(1 − f)/4 = 0; and what lies at or above the larger root bounds the form
    bounded = a * y * y + 2 * b * y * z + c * z * z <= lam * (y * y + z * z)
    assert holds(bounded, lam >= a, lam >= c, (lam - a) * (lam - c) >= b * b)


def test_what_the_mass_gains_before_the_first_force() -> None:
    start, d = z3.Reals("start d")
    # the coast's ½(ξ² − ξ₀²) is ½d², which the bound has, and ξ₀d; from the origin, or from rest, ξ₀d is 0
    assert holds(((start + d) * (start + d) - start * start) / 2 == d * d / 2 + start * d)


HALF = z3.Q(1, 2)


@pytest.mark.parametrize("counts", [1, 2, 7, 217])
def test_a_position_read_with_dither_is_within_q(counts: int) -> None:
    """⌊raw/N + δ⌋ + ½ is within ½ + ⌈Na⌉/N of ξ for |δ| ≤ a; in ticks from the one that is read, which is then 0."""
    shift = z3.Real("shift")  # Nδ, within ±⌈Na⌉
    raw, steps = z3.Ints("raw steps")
    count, most = z3.ToReal(raw), z3.ToReal(steps)
    read = [count + shift >= 0, count + shift < counts, shift <= most, shift >= -most]
    assert holds(z3.And(raw >= -steps, raw + 1 <= counts + steps), *read)
    seen = [count >= -most, count + 1 <= counts + most, count <= counts * x, counts * x < count + 1]
    assert holds(size(HALF - x) <= HALF + most / counts, *seen)


@pytest.mark.parametrize("side", [-1, 0, 1])
@pytest.mark.parametrize("bias", [HALF, z3.Q(0, 1)], ids=["half tick", "none"])
def test_every_spring_is_within_q_of_one_with_slope_at_most_1(side: int, bias: z3.ArithRef) -> None:
    """With n + ½ within q ≥ ½ of ξ the force is −p(ξ) + e, |e| ≤ q; p is ξ, or ξ − ½, or the half of it that a wall has."""
    n = z3.Real("n")
    place = x - (HALF - bias)
    wall = {-1: z3.If(place < 0, place, 0), 0: place, 1: z3.If(place > 0, place, 0)}[side]
    pushes = {-1: n <= -1, 0: z3.BoolVal(True), 1: n >= 0}[side]
    pushed = z3.If(pushes, -(n + bias), 0)
    read = [q >= HALF, size(n + HALF - x) <= q, z3.Or(n <= -1, n >= 0)]
    assert holds(size(pushed + wall) <= q, *read)


def test_a_converter_adds_half_a_step_and_a_limit_nothing() -> None:
    s, low, high, command, ideal = z3.Reals("s low high command ideal")
    code = z3.Int("code")
    rounded = [s > 0, size(command - code * s) <= s / 2]
    assert holds(size(code * s - ideal) <= q + s / 2, *rounded, size(command - ideal) <= q)
    ends = [low <= 0, high >= 0]
    both = size(clipped(ideal + e, low, high) - clipped(ideal, low, high)) <= size(e)
    assert holds(both, *ends)
    slope = clipped(x, low, high) - clipped(held, low, high)
    assert holds(z3.And(slope >= 0, slope <= x - held), x >= held, *ends)


def test_the_grain_of_an_averaged_velocity() -> None:
    # each position is read with an error within ½: a mean over n periods is within 1/n, the low-pass within 1 − a
    first, last, keep, older = z3.Reals("first last keep older")
    errors = [size(first) <= HALF, size(last) <= HALF, size(older) <= HALF]
    for periods in (1, 2, 10):
        assert holds(size(last - first) / periods <= z3.Q(1, periods), *errors)
    # (1 − a)(e_k − the low-passed e before): a mean of errors within ½ is within ½
    assert holds(size((1 - keep) * (last - older)) <= 1 - keep, keep >= 0, keep < 1, *errors)
