"""Builds beliefs of the guard; a plain number stands for a value that is known exactly."""

from typing import Any

from haptic_wall.controller.guard.belief import Belief, Bounded


def belief(**given: Any) -> Belief:
    """Return a belief of these values; friction and lag are 0 and the gain is 1 by default."""
    fields: dict[str, Any] = {"coulomb": 0.0, "delay": 0.0, "torque_gain": 1.0} | given
    for name, value in fields.items():
        if isinstance(value, float):
            fields[name] = Bounded.exactly(value)
    return Belief(**fields)
