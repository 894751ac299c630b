"""The whole configuration, and the values that other rooms derive from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, TypeVar

from pydantic import ValidationInfo, model_validator

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.guard.belief import Belief, Bounded, vibration
from haptic_wall.controller.guard.types import GuardSettings, Request
from haptic_wall.controller.laws import own
from haptic_wall.controller.laws.shape import Grid, LawError, Numbers
from haptic_wall.controller.laws.table import LINEAR, rendered_law, shape_of
from haptic_wall.controller.laws.wall import NONE, SIGNS, Law
from haptic_wall.controller.settings.axes import completed
from haptic_wall.controller.settings.rules import (
    BrokenRulesError,
    broken_rules,
    law_names,
)
from haptic_wall.controller.settings.sections import Sections, bounded
from haptic_wall.controller.settings.shares import DRIVEN_SHARE
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.open import torque_models
from haptic_wall.hw.servo import JUMP_SPEED
from haptic_wall.hw.settings import EMULATED, ServoSettings
from haptic_wall.hw.truth import ABOUT, TrueArm, TrueServo

Made = TypeVar("Made")
APPROACH = 0.1
"""Default distance of a simulated servo's start from a one-sided wall [rad]."""
MOST_KICK = math.tau / 4.0
"""Largest displacement of a simulated or emulated servo at which the wall comes on at once, and may
drive the shaft at any speed [rad]"""
RUNS: Final = {"runs": True}
"""Context of the validation of what a process runs: its laws are imported, see ``laws.own``"""
MOVED_BY_START = math.radians(1.0)
"""Largest motion of an emulated servo during the check of the torque's sign [rad]"""


class Config(Sections):
    """All settings, valid as a whole; travels between processes as JSON."""

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Complete each axis; give real hardware the strict real-time profile by default."""
        if not isinstance(found, dict):
            return found
        found = completed(found)
        servo, realtime = found.get("servo"), found.get("realtime", {})
        if not isinstance(servo, dict) or not isinstance(realtime, dict):
            return found
        if servo.get("backend") != "dynamixel" or servo.get("port") == EMULATED:
            return found
        return {**found, "realtime": {"profile": "strict", **realtime}}

    @model_validator(mode="after")
    def _rules(self, info: ValidationInfo) -> Config:
        if (info.context or {}).get("runs"):
            own.allow([name for one in self.each.values() for name in law_names(one.wall)])
        if problems := broken_rules(self):
            raise BrokenRulesError(problems)
        return self

    @property
    def period_ns(self) -> int:
        """Return the sampling period of the grid [ns]."""
        return round(1e9 / self.loop.rate_hz)

    @property
    def driven_speed(self) -> float:
        """Return the speed that trips where an experiment drives the shaft [rad/s]."""
        most = self.safety.max_speed
        if most is not None:
            return most
        real = self.servo.kind == "hardware"
        return (real and DRIVEN_SHARE * self._no_load_speed) or JUMP_SPEED

    @property
    def planned_speed(self) -> float:
        """Return the speed of which an experiment plans at most a fraction of 0.4 [rad/s].

        Where the limit comes from the model it is 0.8 of a real servo's ``driven_speed``: the plan
        is not exceeded within the bounds of the belief. An emulated servo is planned for like a
        real one.
        """
        if self.safety.max_speed is None and self._no_load_speed:
            return 2.0 * DRIVEN_SHARE * self._no_load_speed
        return self.driven_speed

    @property
    def _no_load_speed(self) -> float:
        """Return the no-load speed of a servo's model [rad/s]; 0: unknown, or simulated."""
        servo = self.servo
        if servo.kind == "simulated" or servo.model is None:
            return 0.0
        return torque_models()[servo.model].no_load_speed

    @property
    def start_position(self) -> float:
        """Return where a simulated or emulated servo starts, at rest [rad]."""
        if self.servo.kick is not None:
            return self.wall.position + self._end + self.servo.kick
        wall = self.wall
        if wall.law == "stops" and wall.low is not None and wall.high is not None:
            return wall.position + max(wall.high - APPROACH, 0.5 * (wall.low + wall.high))
        outside = {"above": -APPROACH, "below": APPROACH, "both": 0.0}
        return wall.position + outside[wall.acting_side]

    @property
    def _end(self) -> float:
        """Position of the upper stop, from which a hand and a kick count [rad]; 0: no stops."""
        wall = self.wall
        return wall.high if wall.law == "stops" and wall.high is not None else 0.0

    @property
    def start_room(self) -> float:
        """Return the penetration up to which the wall comes on with a loaded spring [rad].

        It applies at the start only: 0 on a real servo; infinite where the wall comes on at once. A
        ``servo.kick`` into the spring is an intended impact, up to a quarter turn.
        """
        servo = self.servo
        # the direction in which a kick loads the spring; 0: either
        inward = 1 if self.wall.law == "stops" else SIGNS[self.wall.acting_side]
        if self.safety.engage == "at-once":
            return math.inf
        if servo.kind == "hardware" or self.wall.reference == "start":
            return 0.0
        if servo.kick is not None and abs(servo.kick) > MOST_KICK:
            return 0.0
        if servo.kind == "simulated" and self.loop.clock == "simulated":
            return math.inf  # no warm-up, so it still is at its start: there, or outside
        if servo.kick is None:
            return MOVED_BY_START if inward == 0 else 0.0
        return MOST_KICK if inward == 0 or inward * servo.kick > 0.0 else 0.0

    def surface(self, started_at: float) -> float:
        """Return the position of the wall, counted over turns [rad].

        Args:
            started_at: The first position of the run [rad].
        """
        counted_from = started_at if self.wall.reference == "start" else 0.0
        return counted_from + self.wall.position

    def _own(self, position: float) -> float:
        """Return a position in the servo's own count [rad]."""
        return self.servo.sign * (position - self.servo.offset)

    def true_servo(self) -> TrueServo:
        """Return the true parameters of the simulated or emulated servo.

        Raises:
            ValueError: The servo is real: its true parameters are unknown.
        """
        servo = self.servo
        if servo.kind == "hardware" or servo.inertia is None:
            raise ValueError(f"the servo at {servo.port} is real: only its model.* is known")
        shared = {name: getattr(servo, name) for name in ABOUT if ABOUT[name].kinds}
        toward = -1 if self.wall.acting_side == "below" and servo.hand != "lean" else 1
        return TrueServo(
            **shared,
            torque_limit=4.1 if servo.torque_limit is None else servo.torque_limit,
            torque_constant=servo.torque_constant or 0.0,
            position=self._own(self.start_position),
            hand_origin=self._own(self.surface(self.start_position) + self._end),
            hand_direction=1 if toward == servo.sign else -1,
        )

    def servos(self) -> list[ServoSettings]:
        """Return the settings of each servo, with which ``haptic_wall.hw.open`` opens their bus.

        On the simulated clock an emulated bus lives in memory. On the monotonic clock it is a
        separate process; the process that started it knows its port.
        """
        arm = TrueArm(**self.arm.model_dump())
        return [one._settings(arm) for one in self.each.values()]

    def _settings(self, arm: TrueArm) -> ServoSettings:
        servo = self.servo
        in_memory = servo.kind == "emulated" and self.loop.clock == "simulated"
        asked = servo.asked()
        return replace(
            asked,
            port="" if in_memory else asked.port,
            probe_direction=1 if self.wall.acting_side == "below" else -1,
            period_s=self.period_s,
            read=self.bus.read,
            true=None if servo.kind == "hardware" else self.true_servo(),
            arm=arm,
        )

    def belief(self) -> Belief:
        """Return the belief about the servo: ``model.*``, else the simulated truth.

        Of two viscous frictions, one each way, both are believed. A current loop counts by its
        lag and its period, as delay. The inertia is that of motor and load, or
        with ``model.bare`` that of the motor.
        """
        servo, model = self.servo, self.model
        damping = bounded(model.damping, servo.damping)
        if model.damping is None and servo.damping_back is not None:
            ends = sorted((servo.damping, servo.damping_back))
            damping = Bounded(servo.damping, *ends)
        load = 0.0 if model.bare else servo.load_inertia
        inertia = bounded(model.inertia, (servo.inertia or 0.0) + load)
        load_inertia = bounded(model.load_inertia, servo.load_inertia)
        flexible_hz = bounded(model.flexible_hz, servo.flexible_hz)
        stiffness = Bounded.exactly(0.0)
        if model.flexible_hz is None and model.transmission_stiffness is not None:
            stiffness = bounded(model.transmission_stiffness, 0.0)
            if load_inertia.high > 0.0:
                flexible_hz = vibration(inertia, load_inertia, stiffness, model.bare)
        return Belief(
            inertia=inertia,
            damping=damping,
            coulomb=bounded(model.coulomb, servo.coulomb),
            delay=self.believed_delay(),
            torque_gain=bounded(model.torque_gain, 1.0),
            backlash=bounded(model.backlash, 0.0),
            load_inertia=load_inertia,
            flexible_hz=flexible_hz,
            flexible_damping_ratio=bounded(
                model.flexible_damping_ratio, servo.flexible_damping_ratio
            ),
            encoder=servo.encoder,
            transmission_stiffness=stiffness,
            bare=model.bare,
        )

    def request(self, step: float | None = None) -> Request:
        """Return the requested law, for the guard.

        Args:
            step: The servo's encoder step [rad]; None: as configured.

        Raises:
            ConfigError: The encoder does not resolve the law.
        """
        wall = self.wall
        if wall.law == "wall":
            return Request(
                wall.stiffness,
                wall.damping,
                wall.side,
                wall.velocity_samples,
                velocity_filter=self.velocity_filter(),
            )
        shape = self._of_law(shape_of, step)
        own = shape.own_stiffness
        return Request(
            wall.stiffness if own is None else own,
            0.0 if wall.law == NONE else wall.damping,
            "both" if shape.damped_everywhere else "above",
            wall.velocity_samples,
            f"{wall.law}, {shape.steepest}" if shape.steepest else wall.law,
            wall.law in LINEAR,
            shape.resolved,
        )

    def law(self, step: float) -> Law:
        """Return the law to render, with stiffness and damping 0.

        Args:
            step: The servo's encoder step [rad].

        Raises:
            ConfigError: The encoder does not resolve the law.
        """
        wall = self.wall
        clip = math.inf if wall.torque_clip is None else wall.torque_clip
        return self._of_law(
            lambda numbers, grid: rendered_law(numbers, grid, wall.position, clip), step
        )

    def _of_law(self, ask: Callable[[Numbers, Grid], Made], step: float | None) -> Made:
        """Return the result of ``ask`` with the configured numbers of the law."""
        if step is None:
            step = self.servo.position_step
        try:
            return ask(self.wall, Grid(self.period_s, step))
        except LawError as error:
            problem = Problem(error.found, wanted=error.wanted, field=f"wall.{error.field}")
            raise ConfigError("the law", [problem]) from error

    def guard_settings(self) -> GuardSettings:
        """Return the guard's settings."""
        guard = self.guard
        return GuardSettings(guard.mode, guard.margin, guard.damping_cap, guard.quantisation_share)
