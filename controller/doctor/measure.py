"""Starts the process that measures the timing, and returns its result."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from typing import Any, Final

from haptic_wall.controller.doctor.timing_process import Orders
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.runtime.sampler import COLLECT_SHARE, LONGER_SHARE
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.errors import ServoError

SERIES_S: Final = 0.1
"""Duration of the cycles at one phase"""
REPLIES: Final = 200
"""Number of timed single reads"""
WAKES: Final = 300
"""Number of wake-ups without a bus"""
_MEASURE_S: Final = 120.0
_END_S: Final = 2.0


def measure(config: Config, port: int | None) -> dict[str, Any]:
    """Measure the timing, on the core and with the rights of a run.

    Args:
        config: The configuration of the run.
        port: Descriptor of the open serial port; None: only the machine is measured.

    Returns:
        The answer of ``timing_process``.

    Raises:
        ServoError: The process gave none.
    """
    core, _ = pick_cores(config.realtime.core)
    spin_us = config.realtime.spin_us
    orders = Orders(
        port=port,
        id=config.servo.id,
        period_ns=config.period_ns,
        collect_ns=int(COLLECT_SHARE * config.period_ns),
        longer_ns=int(LONGER_SHARE * config.period_ns),
        series_s=SERIES_S,
        replies=REPLIES,
        wakes=WAKES,
        profile=config.realtime.profile,
        priority=config.realtime.priority,
        spin_ns=None if spin_us is None else round(spin_us * 1000),
        core=core,
        parent=os.getpid(),
    )
    descriptors = [] if port is None else [port]
    child = Child(
        "timing", ["haptic_wall.controller.doctor.timing_process"], asdict(orders), descriptors
    )
    try:
        line = first_line(child, _MEASURE_S)
        if line is None:
            raise ServoError(f"the measurement ended early: it {child.exit_text()}")
    finally:
        child.dismiss(_END_S)
    answer: dict[str, Any] = json.loads(line)
    return answer
