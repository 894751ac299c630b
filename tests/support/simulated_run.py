"""A session on the simulated clock, and its rows."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.session_start import Surroundings
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP, Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus

Rows = NDArray[np.void]


def session(
    preset: str,
    *sets: str,
    duration: float = 2.0,
    telemetry: Telemetry | None = None,
    tell: Callable[[str], None] = lambda _: None,
    clock: SimulatedClock | None = None,
    opener: Callable[..., object] = open_bus,
    warm_up: bool = False,
) -> tuple[Result, Rows]:
    """Run on the simulated clock; the rows, those of the warm-up if asked for."""
    config = load_config(preset, ("loop.clock=simulated", *sets)).config
    telemetry = telemetry or Telemetry.create()
    around = Surroundings(tell=tell, open_bus=opener)  # type: ignore[arg-type]
    result = run_session(
        config, clock or SimulatedClock(), telemetry, duration, surroundings=around
    )
    rows = telemetry.read(0)[0][:, 0]
    return result, rows if warm_up else rows[(rows["flags"] & FLAG_WARM_UP) == 0]
