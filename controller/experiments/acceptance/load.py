"""Measures the torque of a known weight: the shaft travels slowly up and down, without and with it.

Friction acts against the travel, a weight in one direction: so the mean of the torques up and down
is the weight's, half of their difference is the friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.acceptance.predictions import SPEED, Weight
from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.holding import hold_of, torque_limit_of, without_hand
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.settings.config import Config

TRAVEL = 0.15
"""To each side [rad]"""
_FIRST = 2
"""First phase of the travel up and down"""
_MOST_TILT = 0.5
"""Largest angle by which the lever may sink [rad]"""
_CYCLES = 3
_MIDDLE = 0.6
"""Fraction of the travel that is used"""
_SHARE = 0.5
"""Largest torque of weight and friction, over the torque limit"""
SECONDS = 2.0 * (2.0 + (1 + 4 * _CYCLES) * TRAVEL / SPEED)
"""Duration of both runs [s]"""


@dataclass(frozen=True, slots=True)
class Load:
    """What a weight does."""

    torque: Estimated
    """Commanded to balance the weight [N·m]"""
    gain: Estimated
    """Torque of the weight over it"""
    friction: tuple[Estimated, Estimated]
    """Without and with the weight [N·m of commanded torque]"""

    def report(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "torque": self.torque.report(),
            "torque_gain": self.gain.report(),
            "friction_bare": self.friction[0].report(),
            "friction_loaded": self.friction[1].report(),
        }


@dataclass(frozen=True, slots=True)
class _Travelled:
    """Slow travel up and down."""

    torque: Estimated
    """Mean of both ways [N·m]"""
    friction: Estimated
    """Half the difference of the ways [N·m]"""
    place: float
    """Mean position [rad]"""


def measure_load(
    config: Config,
    weight: Weight,
    folder: Path,
    tell: Callable[[str], None],
    ready: Callable[[str], None],
) -> Load:
    """Measure the bare shaft, then the loaded one.

    Args:
        config: Configuration with the best known model.
        weight: The weight; on a simulated or emulated servo it is simulated.
        folder: For the logs.
        tell: Called with messages.
        ready: Called with what a person has to do before each of the two runs.

    Raises:
        UserError: The weight is more than the servo should hold, or too little to be seen.
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
    """
    limit = torque_limit_of(config)
    if weight.torque > _SHARE * limit:
        raise UserError(
            f"found {weight.torque:.3g} N·m",
            field="--weight",
            wanted=f"at most {_SHARE * limit:.3g} N·m, {_SHARE:g} of servo.torque_limit",
            advice="take a smaller weight, or a shorter lever",
        )
    bare_config = without_hand(config)
    ready("bring the lever level, without the weight, and take your hands off")
    bare = _travelled(bare_config, folder, "load-bare", tell)
    ready(
        f"mount the weight of {weight.mass:g} kg at {weight.lever:g} m on the horn; hold the horn"
        " level until the servo holds it, then take your hands off"
    )
    loaded = _travelled(_with(bare_config, weight), folder, "load-weight", tell)
    # The lever was level without the weight; it may have sunk until the servo held it.
    tilt = loaded.place - bare.place
    if abs(tilt) > _MOST_TILT:
        raise UserError(
            f"the horn sank by {abs(tilt):.2g} rad before the servo held it",
            field="--weight",
            wanted=f"a horn that is level within {_MOST_TILT:g} rad",
            advice="hold the horn until the servo holds it, and repeat the step",
        )
    level = math.cos(tilt)
    torque = Estimated(
        abs(loaded.torque.value - bare.torque.value) / level,
        math.hypot(loaded.torque.stderr, bare.torque.stderr) / level,
    )
    if torque.value < 3.0 * torque.stderr:
        raise UserError(
            f"the weight is too small to measure: {torque.value:.2g} ± {torque.stderr:.2g} N·m",
            field="--weight",
            advice="take a larger weight, or a longer lever",
        )
    gain = weight.torque / torque.value
    return Load(
        torque,
        Estimated(gain, gain * torque.stderr / torque.value),
        (bare.friction, loaded.friction),
    )


def _with(config: Config, weight: Weight) -> Config:
    """Return the configuration with a simulated weight on a level lever; a real one as it is."""
    if config.servo.kind == "hardware":
        return config
    raw = config.model_dump(mode="json")
    raw["servo"]["gravity"] = weight.torque
    raw["servo"]["gravity_angle"] = config.start_position - 0.5 * math.pi
    return Config.model_validate(raw)


def _travelled(config: Config, folder: Path, name: str, tell: Callable[[str], None]) -> _Travelled:
    """Return the torques of slow travel up and down."""
    hold = hold_of(config, torque_limit_of(config), config.delay.steps)
    seconds = 2.0 * TRAVEL / SPEED
    phases = [hold.phase(2.0), hold.phase(0.5 * seconds, -TRAVEL, SPEED)]
    for _ in range(_CYCLES):
        phases += [hold.phase(seconds, TRAVEL, SPEED), hold.phase(seconds, -TRAVEL, SPEED)]
    played = Testbed(config, folder, tell).play(name, phases)
    pairs = []
    for cycle in range(_CYCLES):
        ways = []
        for number in (_FIRST + 2 * cycle, _FIRST + 1 + 2 * cycle):
            rows = played.phase(number)
            # By time, not by place: under a weight the shaft hangs below the spring's centre.
            share = np.linspace(0.0, 1.0, len(rows))
            used = rows["torque"][np.abs(share - 0.5) < 0.5 * _MIDDLE]
            ways.append(float(np.mean(used)))
        pairs.append(ways)
    both = np.array(pairs)
    place = float(np.mean(played.rows["position"][played.rows["phase"] >= _FIRST]))
    return _Travelled(_mean(both.mean(axis=1)), _mean(0.5 * (both[:, 0] - both[:, 1])), place)


def _mean(values: Any) -> Estimated:  # noqa: ANN401 - an array of a few numbers
    return Estimated(float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(len(values))))
