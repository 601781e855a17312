"""An identification in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.identify.result import interval_digits

if TYPE_CHECKING:
    from hapticd.gap.result import Estimate
    from hapticd.identify.result import Identified


def describe(result: Identified, key_of_config: str) -> str:
    """A few lines about what was found.

    Args:
        result: what was found.
        key_of_config: the file that it was written into, or empty text.
    """
    lines = [
        f"inertia           {_interval(result.inertia)}",
        f"viscous friction  {_interval(result.viscous)}",
        f"Coulomb friction  {_interval(result.coulomb)}",
        f"bias              {_interval(result.bias)}{'' if result.has_bias else ': none'}",
        f"delay             {_interval(result.delay, 1e6, 'µs')}, declared {1e6 * result.declared_delay_s:.4g} µs",
        f"encoder           {'counts with the torque' if result.sign > 0 else 'counts AGAINST the torque: invert it'}",
    ]
    if result.current_gain is not None:
        lines.append(f"current           measured over commanded {_interval(result.current_gain, 1.0, '')}")
    if result.torque_constant_implied is not None:
        implied = _interval(result.torque_constant_implied)
        lines.append(f"torque constant   {implied}, if the known inertia is right; taken {result.torque_constant:g}")
    lines += [f"assumed: {text}" for text in result.assumed]
    if key_of_config:
        lines.append(f"written: {key_of_config}; hapticd check {key_of_config} says what it means")
    return "\n".join(lines)


def _interval(estimate: Estimate, factor: float = 1.0, unit: str | None = None) -> str:
    low, value, high = (factor * number for number in (estimate.ci95[0], estimate.value, estimate.ci95[1]))
    unit = estimate.unit if unit is None else unit
    digits = interval_digits(estimate)
    return f"{value:.{digits}g} ({low:.{digits}g} … {high:.{digits}g}) {unit}".rstrip()
