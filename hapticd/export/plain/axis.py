"""An axis that commands move."""

from __future__ import annotations

import math
import random
from collections import deque

from hapticd.export.plain.closed_form import glide, swing
from hapticd.export.plain.numbers import Numbers


class Axis:
    """An axis that commands move: `step` after `step`, then look at `position`, `velocity`, `current`, `measured`.

    Args:
        numbers: the axis.
        position: at first. velocity: at first.
        seed: of what the link loses.
    """

    def __init__(self, numbers: Numbers, position: float = 0.0, velocity: float = 0.0, seed: int = 0) -> None:
        self.numbers = numbers
        self.time = 0.0
        self.position, self.velocity = position, velocity
        self.load_position, self.load_velocity = position, velocity
        self.current = 0.0
        """In the motor, mean of the last part of a step, A."""
        self.external = 0.0
        """Torque or force from outside."""
        self._bristle = self._aim = self._lag = self._lag_rate = self._side = 0.0
        self._waiting: deque[tuple[float, float]] = deque()
        # What a link loses is no secret.
        self._random = random.Random(seed)  # noqa: S311
        self._own_inertia = numbers.inertia - numbers.load_inertia

    @property
    def measured(self) -> float:
        """Position as the encoder's disc or tape shows it."""
        n = self.numbers
        return self.position + n.eccentricity * math.sin(self.position + n.eccentricity_phase)

    @property
    def counts(self) -> int:
        """Encoder counts."""
        n = self.numbers
        return math.floor(self.measured / n.resolution) * (-1 if n.counts_backwards else 1)

    def step(self, command: float, span: float) -> None:
        """Give a command [A] now, and move for a time [s]. Each step is one command: what is lost is lost for a step."""
        end = self.time + span
        self.send(command)
        while self._waiting and self._waiting[0][0] < end:
            due, aim = self._waiting.popleft()
            self._advance(due)
            self._aim = aim
        self._advance(end)
        self.time = end

    def send(self, command: float) -> None:
        """Give a command [A] that takes effect after the delay."""
        if self.numbers.lost == 0.0 or self._random.random() >= self.numbers.lost:
            self._waiting.append((self.time + self.numbers.delay_s, self.delivered(command)))

    def delivered(self, command: float) -> float:
        """The current that the amplifier aims at for a command [A]: on its grids, within its limits."""
        n = self.numbers
        if n.dac_step > 0.0:
            command = min(max(round(command / n.dac_step), -n.dac_codes - 1), n.dac_codes) * n.dac_step
        command = min(max(command, -n.current_limit), n.current_limit)
        return n.command_step * round(command / n.command_step) if n.command_step > 0.0 else command

    def motor_current(self, span: float) -> float:
        """Move the current loop on, and return its mean current [A] over that time."""
        n = self.numbers
        if n.lag_hz == math.inf:
            self._lag = self._aim
            return self._aim
        natural = 2.0 * math.pi * n.lag_hz
        before, rate = self._lag, self._lag_rate
        off, self._lag_rate = swing(before - self._aim, rate, natural, n.lag_ratio, span)
        self._lag = self._aim + off
        late = (self._lag_rate - rate) / natural + 2.0 * n.lag_ratio * (self._lag - before)
        return self._aim - late / (natural * span)

    def amplify(self, span: float) -> float:
        """Let a time [s] pass for the commands alone, and return the motor's mean current [A] over it."""
        end, charge = self.time + span, 0.0
        while self._waiting and self._waiting[0][0] < end:
            due, aim = self._waiting.popleft()
            if due > self.time:
                charge += self.motor_current(due - self.time) * (due - self.time)
                self.time = due
            self._aim = aim
        charge += self.motor_current(end - self.time) * (end - self.time)
        self.time = end
        return charge / span

    def is_held(self, time: float) -> bool:
        """Whether the hand holds the axis."""
        return self.numbers.hand_on_s <= time < self.numbers.hand_off_s

    def pull(self, position: float, velocity: float, current: float, time: float) -> float:
        """All torques but the device's friction."""
        n = self.numbers
        total = n.torque_constant * current + n.bias + self.external - n.damping * velocity
        total -= n.stiffness * (position - n.rest)
        if n.gravity != 0.0:
            total -= n.gravity * math.sin(position - n.gravity_rest)
        if n.ripple:
            gain = 1.0 - n.ripple_proportion + n.ripple_proportion * current
            total += gain * sum(height * math.sin(order * position + phase) for order, height, phase in n.ripple)
        if self.is_held(time):
            total -= n.hand_stiffness * (position - n.hand_rest) + n.hand_damping * velocity
        return total

    def coulomb(self, speed: float, current: float, time: float) -> float:
        """Friction that does not grow with the speed, at a speed ≥ 0; at 0 what holds the axis."""
        n = self.numbers
        level = n.coulomb
        if n.warming != 0.0:
            level *= 1.0 - n.warming * math.expm1(-time / n.warming_time_s)
        if n.stribeck_share != 0.0:
            level *= 1.0 + n.stribeck_share * math.exp(-((speed / n.stribeck_speed) ** 2))
        return level + n.load_friction * abs(n.torque_constant * current)

    def friction(self, velocity: float, current: float, time: float) -> tuple[float, float]:
        """Coulomb and viscous friction that act at a velocity."""
        n = self.numbers
        speed = abs(velocity)
        viscous = n.viscous * (1.0 + n.viscous_asymmetry * math.copysign(1.0, velocity))
        level = self.coulomb(speed, current, time)
        if n.drag > 0.0:
            viscous += n.drag * speed
        elif n.drag < 0.0:
            level -= min(-n.drag * speed * speed, level + viscous * speed)
        return level, viscous

    def torque(self, position: float, velocity: float, current: float, time: float) -> float:
        """The torque that accelerates the inertia; at rest 0 where stiction holds."""
        pull = self.pull(position, velocity, current, time)
        level, viscous = self.friction(velocity, current, time)
        if velocity == 0.0:
            return math.copysign(max(abs(pull) - level, 0.0), pull)
        return pull - math.copysign(level, velocity) - viscous * velocity

    def _advance(self, end: float) -> None:
        n = self.numbers
        switches = sorted(at for at in (n.hand_on_s, n.hand_off_s) if self.time < at < end)
        for until in (*switches, end):
            begin, span = self.time, until - self.time
            parts = max(math.ceil(span / n.longest_part_s - 1e-9), 1) if span > 0.0 else 0
            for k in range(parts):
                self._part(span / parts, begin + (k + 0.5) * span / parts)
            self.time = until

    def _part(self, span: float, time: float) -> None:
        n = self.numbers
        self.current = self.motor_current(span)
        own = self._own_inertia + (n.hand_inertia if self.is_held(time) else 0.0)
        if n.play > 0.0:
            self._move_with_play(span, own, time)
        elif n.coupling_stiffness > 0.0:
            self._move_with_coupling(span, own, time)
        else:
            self._move(span, own, 0.0, time)
            self.load_position, self.load_velocity = self.position, self.velocity

    def _move(self, span: float, inertia: float, beside: float, time: float) -> None:
        for _ in range(10_000):
            span -= self._phase(span, inertia, beside, time)
            if span <= 0.0:
                return

    def _phase(self, span: float, inertia: float, beside: float, time: float) -> float:
        """Move the motor one way under a torque besides the axis' own; return the time taken: to a stop, or the span."""
        n = self.numbers
        x, v, z = self.position, self.velocity, self._bristle
        has_bristle = n.breakaway > 0.0 and n.coulomb > 0.0
        stiff = n.coulomb / n.breakaway if has_bristle else 0.0
        still = self.pull(x, v, self.current, time) + beside - stiff * z
        held = 0.0 if has_bristle else self.coulomb(0.0, self.current, time)
        if v == 0.0 and abs(still) <= held:
            return span
        sign = math.copysign(1.0, v if v != 0.0 else still)
        speed = abs(v)
        way, end, taken = 0.0, speed, span
        if n.stribeck_share != 0.0 and not has_bristle and speed < 4.0 * n.stribeck_speed:
            # No longer than friction is about the same: half a Stribeck speed of change.
            most = (abs(still) + n.coulomb * (1.0 + abs(n.stribeck_share))) / inertia
            span = min(span, 0.2 * n.stribeck_speed / most)
        steady = n.breakaway
        for attempt in range(4):
            mean = 0.5 * (speed + end)
            level, viscous = self.friction(sign * mean if mean > 0.0 else sign * 1e-300, self.current, time)
            drive = sign * (self.pull(x + 0.5 * sign * way, sign * mean, self.current, time) + beside)
            if has_bristle:
                steady = max(level / stiff, 1e-6 * n.breakaway)
                slack = sign * z - steady
                if attempt == 0 and abs(slack) > 1e-3 * steady:
                    span = min(span, 0.1 / math.sqrt(stiff / inertia), 0.2 * steady / (speed + 1e-300))
                stretch = slack * (-math.expm1(-way / steady) * steady / way if way > 1e-9 * steady else 1.0)
                drive -= stiff * (steady + stretch)
                viscous += n.bristle_damping * max(-stretch / steady, 0.0)
            else:
                drive -= level
            way, end, taken = glide(speed, drive / inertia, viscous / inertia, span)
        self.position, self.velocity = x + sign * way, sign * end if end > 0.0 else 0.0
        if has_bristle:
            self._bristle = sign * (steady + (sign * z - steady) * math.exp(-way / steady))
        return taken if taken > 0.0 else span

    def _move_with_coupling(self, span: float, own: float, time: float) -> None:
        n = self.numbers
        begin = self.position, self.velocity, self._bristle
        load, load_velocity = self.load_position, self.load_velocity
        twist, rate = load - begin[0], load_velocity - begin[1]
        torque = n.coupling_stiffness * twist + n.coupling_damping * rate
        for _ in range(4):
            self.position, self.velocity, self._bristle = begin
            self._move(span, own, torque, time)
            change = -torque / n.load_inertia * span
            self.load_velocity = load_velocity + change
            self.load_position = load + (load_velocity + 0.5 * change) * span
            later, later_rate = self.load_position - self.position, self.load_velocity - self.velocity
            torque = 0.5 * (n.coupling_stiffness * (twist + later) + n.coupling_damping * (rate + later_rate))

    def _move_with_play(self, span: float, own: float, time: float) -> None:
        n = self.numbers
        half, both = 0.5 * n.play, own + n.load_inertia
        parted = False
        for _ in range(10_000):
            if span <= 0.0:
                return
            begin = self.position, self.velocity, self._bristle
            if self._side != 0.0:
                taken = self._phase(span, both, 0.0, time)
                # In contact for as long as it pushes the load; what parts and meets again at once stays together.
                if self._side * (self.velocity - begin[1]) >= 0.0 or parted:
                    self.load_position, self.load_velocity = self.position - self._side * half, self.velocity
                    span, parted = span - taken, False
                    continue
                self.position, self.velocity, self._bristle = begin
                self._side, parted = 0.0, True
            taken = self._phase(span, own, 0.0, time)
            apart = self.position - self.load_position - self.load_velocity * taken
            if abs(apart) > half:
                side = math.copysign(1.0, apart)
                early = 0.0
                for _ in range(50):
                    middle = 0.5 * (early + taken)
                    self.position, self.velocity, self._bristle = begin
                    reached = self._phase(middle, own, 0.0, time) if middle > 0.0 else 0.0
                    way = side * (self.position - self.load_position - self.load_velocity * reached)
                    early, taken = (early, middle) if way >= half else (middle, taken)
                self.position, self.velocity, self._bristle = begin
                self._phase(taken, own, 0.0, time)
                closing = self.velocity - self.load_velocity
                common = (own * self.velocity + n.load_inertia * self.load_velocity) / both
                rebound = n.restitution * closing
                self.load_position = self.position - side * half
                self.velocity = self.load_velocity = common
                self._side = side
                # Slower masses stay together, or the rebounds would never end.
                if abs(rebound) > 2.0 * half:
                    self.velocity -= rebound * n.load_inertia / both
                    self.load_velocity += rebound * own / both
                    self.load_position = self.position - side * half * (1.0 - 1e-9)
                    self._side = 0.0
            else:
                self.load_position += self.load_velocity * taken
            span -= taken
            parted = parted and taken < 1e-9
