"""Computes what the lesson of ``haptic-wall demo`` says about a wall, and the walls that it tries.

Nothing here is measured, and no number of a servo is written here: all follows from the servo's
configuration and its delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from haptic_wall.controller.live.relay import is_number
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import critical_point, max_virtual_damping, passive_limit, peak
from haptic_wall.controller.theory.harmonic import clipped_cycle
from haptic_wall.controller.theory.one_sided import one_sided_limit

SOFT: Final = 0.3
"""Of the limit: a wall that is calm [1]"""
STIFF: Final = 1.15
"""Of the limit: a wall that oscillates [1]"""
FAR: Final = 4.0
"""Of the limit: a wall that nobody should ask for [1]"""
LATE: Final = 0.6
"""Of the limit: a wall that oscillates only with more delay [1]"""
TOO_MUCH: Final = 1.08
"""Of the damping's ceiling [1]"""
BOUNDS: Final = {
    "inertia": (1e-7, 10.0),
    "damping": (0.0, 10.0),
    "period": (1e-4, 0.1),
    "delay": (0.0, 0.1),
    "virtual_damping": (0.0, 10.0),
}
"""Of a servo that a reader describes: SI units"""
MOST_PERIODS: Final = 50
"""Longest delay of such a servo, in periods"""


def facts(config: Config, delay: float) -> dict[str, Any]:
    """Return what the lesson says about the wall that is asked for.

    Args:
        config: Of the servo, which is as it is believed to be, and of the wall.
        delay: The total delay, the inserted one included [s].

    Returns:
        ``asked`` and ``servo`` as they are configured, the ``limit`` of the stiffness at this
        damping, and ``frequency_hz`` at it; ``rule``, the same by half a period and the delay;
        ``damping_ceiling``, ``peak``; ``swings_hz``, of the oscillation that the torque limit
        bounds, null where theory knows of none. SI units.
    """
    belief, period = config.belief(), config.period_ns * 1e-9
    inertia, damping = belief.inertia.low, belief.damping.low
    stiffness, virtual = config.wall.stiffness, config.wall.damping
    loop = (period, delay)
    point = critical_point(inertia, damping, virtual, *loop)
    best = peak(inertia, damping, *loop)
    torque = config.true_servo().torque_limit
    return {
        "asked": {"stiffness": stiffness, "damping": virtual},
        "servo": {"inertia": inertia, "damping": damping, "torque_limit": torque},
        "period": period,
        "delay": delay,
        "late": 0.5 * period + delay,
        "limit": float(point.stiffness),
        "frequency_hz": float(point.frequency),
        "rule": (damping + virtual) / (0.5 * period + delay),
        "damping_ceiling": float(max_virtual_damping(inertia, damping, *loop)),
        "peak": {"stiffness": float(best.stiffness), "damping": float(best.virtual_damping)},
        "swings_hz": _swings_hz(config, delay),
    }


def _swings_hz(config: Config, delay: float) -> float | None:
    """Return the frequency of the limit cycle of the torque limit [Hz]; None: there is none.

    The weight loads the wall with half of the torque limit, so that its torque has as much room
    upward as down to nothing.
    """
    belief, torque = config.belief(), config.true_servo().torque_limit
    if not torque or config.wall.stiffness <= 0.0:
        return None
    cycle = clipped_cycle(
        belief.inertia.low,
        belief.damping.low,
        config.wall.stiffness,
        config.wall.damping,
        config.period_ns * 1e-9,
        delay,
        0.5 * torque,
    )
    return None if cycle is None else cycle.frequency


def scenes(config: Config, delay: float) -> dict[str, dict[str, float]]:
    """Return the walls that the lesson tries, by name; each is a change as of ``haptic-wall set``.

    Args:
        config: Of the servo; the wall in it gives the damping, and the delay that is inserted
            nothing.
        delay: The total delay without an inserted one [s].
    """
    belief, period = config.belief(), config.period_ns * 1e-9
    servo = belief.inertia.low, belief.damping.low
    virtual = config.wall.damping
    limit = float(critical_point(*servo, virtual, period, delay).stiffness)
    best = peak(*servo, period, delay)
    steps = 1
    while float(critical_point(*servo, virtual, period, delay + steps * period).stiffness) > (
        LATE * limit / STIFF
    ):
        steps += 1

    def wall(stiffness: float, damping: float, steps: int = 0) -> dict[str, float]:
        return {
            "wall.stiffness": float(f"{stiffness:.3g}"),
            "wall.damping": float(f"{damping:.3g}"),
            "delay.steps": steps,
        }

    ceiling = float(max_virtual_damping(*servo, period, delay))
    return {
        "soft": wall(SOFT * limit, virtual),
        "stiff": wall(STIFF * limit, virtual),
        "prompt": wall(LATE * limit, virtual),
        "late": wall(LATE * limit, virtual, steps),
        "damped": wall(STIFF * limit, float(best.virtual_damping)),
        "too_much": wall(STIFF * limit, TOO_MUCH * ceiling),
        "far": wall(FAR * limit, virtual),
    }


def own_servo(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the limits of a servo that a reader describes.

    Args:
        given: ``inertia`` [kg·m²], ``damping`` [N·m·s/rad], ``period`` [s], ``delay`` [s] and
            ``virtual_damping`` [N·m·s/rad].

    Returns:
        ``exact``, ``one_sided`` and ``passive`` limits of the stiffness [N·m/rad], ``frequency_hz``
        at the exact one, null where no stiffness is stable, ``damping_ceiling`` and ``peak``. Where
        the description is not valid only ``trouble``, a sentence.
    """
    values: dict[str, float] = {}
    for name, (least, most) in BOUNDS.items():
        value = given.get(name)
        if not is_number(value) or not least <= value <= most:
            return {"trouble": f"{name}: found {value!r:.40}; wanted {least:g} to {most:g}"}
        values[name] = float(value)
    if values["delay"] > MOST_PERIODS * values["period"]:
        return {
            "trouble": f"delay: found {values['delay']:g} s; wanted at most {MOST_PERIODS} periods"
        }
    servo = values["inertia"], values["damping"]
    loop = values["period"], values["delay"]
    virtual = values["virtual_damping"]
    try:
        point = critical_point(*servo, virtual, *loop)
        best = peak(*servo, *loop)
        exact = float(point.stiffness)
        return {
            "exact": exact,
            "one_sided": float(one_sided_limit(*servo, virtual, *loop)) if exact else 0.0,
            "passive": max(0.0, float(passive_limit(servo[1], virtual, *loop))),
            "frequency_hz": float(point.frequency) if exact else None,
            "damping_ceiling": float(max_virtual_damping(*servo, *loop)),
            "peak": {"stiffness": float(best.stiffness), "damping": float(best.virtual_damping)},
        }
    except ValueError as error:
        return {"trouble": str(error)}
