"""Runs a loop's process that times each stage of the tick; ``stages`` starts it.

It reads one JSON object of orders on standard input and writes one of figures on standard output.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.bench.stage_times import StageTimes
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.runtime.session import Surroundings, run_session
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.orders import read_orders
from haptic_wall.hw.clock import Clock, MonotonicClock
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.servo import Servo
from haptic_wall.hw.settings import ServoSettings

_PERCENTILES = (50, 99)


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders to the loop's process."""

    config: str
    """The effective configuration as JSON"""
    parent: int
    core: int
    seconds: float


def main() -> None:
    """Run as ordered, and write the figures."""
    orders = Orders(**read_orders())
    realtime.die_with_parent(orders.parent, signal.SIGTERM)
    config = Config.model_validate_json(orders.config)
    times, clock = StageTimes(), MonotonicClock()
    servo = open_servo(config.servo_settings(), clock)

    def opener(_settings: ServoSettings, _clock: Clock, _port: int | None) -> Servo:
        return servo

    def prepare() -> None:
        realtime.apply(config.realtime.profile, config.realtime.priority, {orders.core})

    with times.listening(type(servo)):
        try:
            around = Surroundings(take_real_time=prepare, open_servo=opener)
            result = run_session(
                config, clock, Telemetry.create(mapped=True), orders.seconds, surroundings=around
            )
        except ServoError as error:
            _tell({"refused": str(error)})
            return
    stages = times.times_us(round(config.loop.warm_up_s * config.loop.rate_hz) + 1)
    _tell(
        {
            "stop_reason": result.stop_reason,
            "stages_us": {
                name: np.percentile(each, _PERCENTILES).tolist() for name, each in stages.items()
            },
            "samples_us": {name: np.round(each, 2).tolist() for name, each in stages.items()},
            "timing_us": 1e-3 * float(np.median(times.inside_ns) + np.median(times.around_ns)),
        }
    )


def _tell(figures: dict[str, object]) -> None:
    os.write(sys.stdout.fileno(), (json.dumps(figures) + "\n").encode())


if __name__ == "__main__":
    main()
