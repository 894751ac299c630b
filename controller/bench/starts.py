"""Measures how long a start computes the guard's decisions, before a servo is switched on."""

from __future__ import annotations

from functools import partial
from typing import Final

from haptic_wall.controller.bench.rows import Section, interleaved, over_rounds
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.runtime.handover import KnownServo
from haptic_wall.controller.runtime.session_start import decisions
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Traffic

_ROUNDS = 3
_LOADED = [
    "model.load_inertia={value: 0.004, low: 0.001, high: 0.008}",
    "model.inertia={value: 0.016, low: 0.013, high: 0.02}",
    "model.flexible_damping_ratio={value: 0.03, low: 0.005, high: 0.1}",
]
_ARM = ["base", "shoulder", "elbow", "forearm", "wrist", "gripper"]
CASES: Final = {
    "a rigid servo": ("emulated-xm430", []),
    "a link of 40 to 52 Hz, as identified": (
        "emulated-xm430",
        [
            "model.load_inertia={value: 0.003, low: 0.002, high: 0.004}",
            "model.inertia={value: 0.015, low: 0.012, high: 0.018}",
            "model.flexible_hz={value: 46, low: 40, high: 52}",
            "model.flexible_damping_ratio={value: 0.03, low: 0.01, high: 0.06}",
        ],
    ),
    "a link of 168 to 500 Hz": (
        "emulated-xm430",
        [*_LOADED, "model.flexible_hz={value: 300, low: 168, high: 500}", "wall.damping=0.05"],
    ),
    "a link of 10 to 100 Hz, behind an adapter with a timer of 16 ms": (
        "emulated-xm430",
        [*_LOADED, "model.flexible_hz={value: 40, low: 10, high: 100}", "guard.sample_age=0.016"],
    ),
    "six axes, each with another damping": (
        "emulated-arm",
        [f"axes.{axis}.wall.damping={0.01 + 0.003 * i}" for i, axis in enumerate(_ARM)],
    ),
}
"""Preset and settings of each"""


def measure() -> Section:
    """Measure the decisions of some configurations, each without what was computed before."""
    work = {
        what: partial(_decide, load_config(preset, [*sets, "servo.backend=simulated"]).config)
        for what, (preset, sets) in CASES.items()
    }
    times = interleaved(work, _ROUNDS)
    return Section(
        tuple(over_rounds(f"decisions for {what}", each, "s") for what, each in times.items())
    )


def _decide(run: Config) -> None:
    bus = open_bus(run.servos(), SimulatedClock(), None)
    servos = [KnownServo(facts, Traffic([]), simulated=False) for facts in bus.facts]
    decisions(zip(run.each.values(), servos, strict=True), Work())
