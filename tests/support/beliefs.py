"""What the guard believes of a servo: a number is known exactly."""

from typing import Any

from haptic_wall.controller.guard.belief import Belief, Bounded


def belief(**given: Any) -> Belief:
    """A belief of these values; without Coulomb friction and lag, and of gain 1, if not given."""
    fields: dict[str, Any] = {"coulomb": 0.0, "delay": 0.0, "torque_gain": 1.0} | given
    for name, value in fields.items():
        if isinstance(value, float):
            fields[name] = Bounded.exactly(value)
    return Belief(**fields)
