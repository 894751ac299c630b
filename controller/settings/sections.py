"""The sections of a configuration as one object, each section valid by itself."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field

from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.settings.axes import OWN, Arm, Axis, AxisName, Bus
from haptic_wall.controller.settings.axis_names import MOST_AXES
from haptic_wall.controller.settings.model import (
    Delay,
    Estimate,
    Guard,
    Loop,
    Model,
    Realtime,
    Safety,
    Section,
    Wall,
)
from haptic_wall.controller.settings.servo import Servo

if TYPE_CHECKING:
    from haptic_wall.controller.theory.velocity_filter import VelocityFilter


class Sections(Section):
    """All sections; the rules between fields read it."""

    loop: Loop = Loop()
    realtime: Realtime = Realtime()
    wall: Wall = Wall()
    delay: Delay = Delay()
    guard: Guard = Guard()
    servo: Servo = Servo()
    model: Model = Model()
    safety: Safety = Safety()
    bus: Bus = Bus()
    arm: Arm = Arm()
    axes: dict[AxisName, Axis] = Field({}, max_length=MOST_AXES)

    @property
    def each(self) -> dict[str, Self]:
        """Return the configuration of each axis by name, as if it were alone; one has no name."""
        if not self.axes:
            return {"": self}
        alone: dict[str, Any] = {"axes": {}, "arm": Arm()}
        bare = {"bare": True} if len(self.axes) > 1 else {}
        return {
            name: self.model_copy(
                update=alone
                | {part: getattr(axis, part) for part in OWN}
                | {"model": axis.model.model_copy(update=bare)}
            )
            for name, axis in self.axes.items()
        }

    @property
    def period_s(self) -> float:
        """Return the sampling period T [s]."""
        return 1.0 / self.loop.rate_hz

    def believed_delay(self) -> Bounded:
        """Return the belief of the lag from sending a torque until it acts [s]."""
        model, servo = self.model, self.servo
        if model.current_bandwidth is None:
            return bounded(model.delay, servo.delay + servo.current_lag)
        delay = bounded(model.delay, servo.delay + servo.current_period)
        loop = model.current_bandwidth
        value, low, high = (1.0 / (math.tau * f) for f in (loop.value, loop.high, loop.low))
        return Bounded(delay.value + value, delay.low + low, delay.high + high)

    def velocity_filter(self) -> VelocityFilter | None:
        """Return the filter of the velocity that damps; None: there is none."""
        from haptic_wall.controller.theory.velocity_filter import (
            VelocityFilter,  # not at the top: it loads the theory's arrays
        )

        wall = self.wall
        if wall.velocity_filter == "none":
            return None
        w0 = math.tau * wall.velocity_hz * self.period_s
        return VelocityFilter(wall.velocity_filter, w0, wall.velocity_q)


def bounded(estimate: Estimate[float] | None, truth: float) -> Bounded:
    """Return the belief of one quantity; the rules ensure that hardware has an estimate."""
    if estimate is None:
        return Bounded.exactly(truth)
    return Bounded(estimate.value, estimate.low, estimate.high)
