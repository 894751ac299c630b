"""Recognise forces on a shaft whose motion an inertia with friction does not explain."""

from __future__ import annotations

import numpy as np

from controller.experiments.fitting import Fit, smoothed, torque_on
from controller.experiments.motion_model import Motion

_SHARE = 0.05
"""Of the torque, from which a spring or a load is named"""


def outside_forces(motion: Motion, fit: Fit) -> str:
    """Whether a spring or a constant load would explain it, in words.

    The torque that acted is regressed on acceleration, speed and its sign, and beside them on the
    position and a constant.

    Args:
        motion: As recorded.
        fit: The model without them; its delay is used.
    """
    speed, acceleration = smoothed(motion)
    moving = np.abs(speed) > 0.1 * np.max(np.abs(speed))
    torque = torque_on(motion, [max(fit.delay, 0.0)])[0][moving]
    position = motion.position - motion.position[0]
    columns = np.column_stack(
        [
            acceleration[moving],
            speed[moving],
            np.sign(speed[moving]),
            position[moving],
            np.ones(torque.size),
        ]
    )
    *_, stiffness, load = np.linalg.lstsq(columns, torque, rcond=None)[0].tolist()
    size = float(np.sqrt(np.mean(torque**2)))
    found = []
    if abs(stiffness) * float(np.std(position)) > _SHARE * size:
        found.append(f"it moves as if a spring of {stiffness:.2g} N·m/rad were attached")
    if abs(load) > _SHARE * size:
        found.append(f"it moves as if a load of {-load:+.2g} N·m were on it, such as a weight")
    return " and ".join(found) or (
        "neither a spring nor a constant load would explain it: a loose horn, a hand, or friction"
        " that changes with the position would"
    )
