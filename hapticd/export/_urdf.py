"""A model as URDF: one joint with dynamics and limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hapticd.export.axis_numbers import axis_numbers

if TYPE_CHECKING:
    from hapticd.config import Config

_GRAVITY = 9.81
_LEVER = 0.1
"""Share of the inertia that the mass of a pendulum has about the axis at most."""
_MASS = 1e-3
"""Of a link that turns about its centre, kg: any."""


def urdf(config: Config, remarks: list[str]) -> str:
    """A config's axis as a robot with one joint: ``continuous``, or ``prismatic`` of a linear one.

    A URDF's joint takes a torque or force; the torque constant stands in a comment.

    Args:
        config: the model.
        remarks: what is said at the head, a sentence each.
    """
    n = axis_numbers(config)
    is_linear = config.is_linear
    friction = n.coulomb
    inertia, mass, place = n.inertia, n.inertia if is_linear else _MASS, "0 0 0"
    if n.gravity and not is_linear:
        lever = _LEVER * inertia * _GRAVITY / n.gravity
        mass = n.gravity / (_GRAVITY * lever)
        inertia -= mass * lever * lever
        place = f"{-lever * math.sin(n.gravity_rest):.9g} 0 {-lever * math.cos(n.gravity_rest):.9g}"
    effort = n.torque_constant * n.current_limit
    limit = effort if effort < math.inf else 1e9
    speed = config.safety.max_velocity
    torque, unit, per = ("force", "N", "N/A") if is_linear else ("torque", "N m", "N m/A")
    bounds = 'lower="-1e3" upper="1e3" ' if is_linear else ""
    said = [
        *remarks,
        f"The joint takes a {torque} in {unit}: {n.torque_constant:.9g} {per} times the motor's current.",
        "Whether friction and damping act is the simulator's choice: Gazebo and MuJoCo take them, RViz has no dynamics.",
    ]
    size = f"{inertia:.9g}"
    lines = [
        '<?xml version="1.0"?>',
        "<!--",
        *(f"  {line}" for line in said),
        "-->",
        '<robot name="axis">',
        '  <link name="base"/>',
        '  <link name="motor">',
        "    <inertial>",
        f'      <origin xyz="{place}"/>',
        f'      <mass value="{mass:.9g}"/>',
        f'      <inertia ixx="{size}" iyy="{size}" izz="{size}" ixy="0" ixz="0" iyz="0"/>',
        "    </inertial>",
        "  </link>",
        f'  <joint name="joint" type="{"prismatic" if is_linear else "continuous"}">',
        '    <parent link="base"/>',
        '    <child link="motor"/>',
        f'    <axis xyz="{"1 0 0" if is_linear else "0 -1 0"}"/>',
        f'    <dynamics damping="{n.viscous + n.damping:.9g}" friction="{friction:.9g}"/>',
        f'    <limit {bounds}effort="{limit:.9g}" velocity="{speed or 1e9:.9g}"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"
