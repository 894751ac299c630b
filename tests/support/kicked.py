"""Simulates a sampled two-sided wall on one true servo, and looks for the stiffness that is bad."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.settings import TrueServo

PERIOD_NS = 1_000_000
PERIOD_S = PERIOD_NS * 1e-9


def kicked(
    true: TrueServo, stiffness: float, damping: float, kick: float, count: int, furthest: float
) -> list[float] | None:
    """Return the true positions at the samples [rad]; None: the shaft went too far.

    Args:
        true: The servo.
        stiffness: K [N·m/rad].
        damping: B [N·m·s/rad].
        kick: Displacement from the wall at the start [rad].
        count: Number of samples.
        furthest: Measured distance from the wall at which the simulation ends [rad].
    """
    servo = Mechanism(replace(true, position=kick), 0)
    before, positions = servo.measured_position(), []
    for k in range(count):
        servo.advance(k * PERIOD_NS)
        x = servo.measured_position()
        servo.command(-stiffness * x - damping * (x - before) / PERIOD_S, k * PERIOD_NS)
        before = x
        positions.append(servo.position)
        if abs(x) > furthest:
            return None
    return positions


def least_bad(bad: Callable[[float], bool], shares: Sequence[float], halvings: int) -> float:
    """Return the first share that is bad, or one below it by halving; the last if none is."""
    low = 0.0
    for high in shares:
        if bad(high):
            break
        low = high
    else:
        return shares[-1]
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if bad(middle) else (middle, high)
    return high
