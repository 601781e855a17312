"""What MJCF cannot say of the model, as MuJoCo's callback for passive forces."""

from __future__ import annotations

import math
from typing import Any

from hapticd.export.plain.axis import Axis
from hapticd.export.plain.model import MODEL, PERIOD_S


class Passive:
    """Sets a joint's friction, adds what else acts on it, and is its motor: the actuator's ctrl is the command in A.

    Args:
        model: MuJoCo's; the actuator's own gain becomes 0, since the motor is here.
        joint: the axis. actuator: its motor.
    """

    def __init__(self, model: Any, joint: str = "joint", actuator: str = "command") -> None:
        self._signature = model.signature
        self._place, self._dof = int(model.joint(joint).qposadr[0]), int(model.joint(joint).dofadr[0])
        self._actuator = int(model.actuator(actuator).id)
        self._armature, self._whole = float(model.dof_armature[self._dof]), float(model.dof_M0[self._dof])
        self._stiff = MODEL.coulomb / MODEL.breakaway if MODEL.breakaway > 0.0 else 0.0
        model.actuator_gainprm[self._actuator, 0] = 0.0
        if self._stiff:
            model.dof_frictionloss[self._dof] = 0.0
        self._at = math.inf  # so that the first call begins

    def _begin(self, position: float) -> None:
        self.axis = Axis(MODEL, position)
        self._at, self._next, self._sent = -1.0, 0.0, math.nan
        self._bristle = 0.0

    def __call__(self, model: Any, data: Any) -> None:
        """As MuJoCo calls it, once a step or more often."""
        if model.signature != self._signature:
            return
        position, velocity = float(data.qpos[self._place]), float(data.qvel[self._dof])
        if data.time < self._at:
            self._begin(position)
        if data.time > self._at:
            self._send(float(data.ctrl[self._actuator]), float(data.time))
            self.axis.current = self.axis.amplify(float(model.opt.timestep))
            self._stretch(position, velocity, float(data.time))
            self._at = float(data.time)
        axis, time, current = self.axis, float(data.time), self.axis.current
        level, viscous = axis.friction(velocity, current, time)
        torque = axis.pull(position, velocity, current, time) - (viscous - MODEL.viscous) * velocity
        if self._stiff:
            steady = math.copysign(level / self._stiff, velocity) or 1e-300
            rate = velocity * (1.0 - self._bristle / steady)
            torque -= self._stiff * self._bristle + MODEL.bristle_damping * rate
        else:
            # Drag with d < 0 may take more than the Coulomb friction: the rest of it is off the joint's damping.
            model.dof_frictionloss[self._dof] = max(level, 0.0)
            torque -= math.copysign(1.0, velocity) * min(level, 0.0)
        held = MODEL.hand_inertia if axis.is_held(time) else 0.0
        model.dof_armature[self._dof] = self._armature + held
        model.dof_M0[self._dof] = self._whole + held  # what MuJoCo takes where no other body is on the joint's
        data.qfrc_passive[self._dof] += torque

    def measured(self, data: Any) -> float:
        """The position as the encoder's disc or tape shows it."""
        self.axis.position = float(data.qpos[self._place])
        return self.axis.measured

    def _send(self, command: float, time: float) -> None:
        self.axis.time = time
        # A link that loses commands does so once a period of the loop; another one need not be told the same again.
        if time >= self._next - 1e-9 if MODEL.lost > 0.0 else command != self._sent:
            self.axis.send(command)
            self._next, self._sent = time + PERIOD_S, command

    def _stretch(self, position: float, velocity: float, time: float) -> None:
        way, self.axis.position = position - self.axis.position, position
        if self._stiff and way != 0.0:
            level, _ = self.axis.friction(velocity, self.axis.current, time)
            steady = math.copysign(level / self._stiff, way)
            self._bristle = steady + (self._bristle - steady) * math.exp(-way / steady)


def install(model: Any, joint: str = "joint", actuator: str = "command") -> Passive:
    """Have MuJoCo call it for this model; another callback for passive forces is replaced."""
    import mujoco

    passive = Passive(model, joint, actuator)
    mujoco.set_mjcb_passive(passive)
    return passive
