"""Runs the loop's own tick on a trial's servo, on the simulated clock, and records the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.detector.watch import oscillation_report
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.schedule import Allowed, GainTable
from haptic_wall.controller.guard.types import Decision
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.runtime.assembly import (
    assembled,
    bins_of,
    gain_table,
    most_injected,
)
from haptic_wall.controller.runtime.cycle import Cycle
from haptic_wall.controller.runtime.handover import Inbox, KnownServo
from haptic_wall.controller.runtime.telemetry import FLAG_SATURATED, NO_DEAD_MAN, Telemetry, Word
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.servo import Facts
from tests.support.operators import NOBODY, Operator, draw_operator, operator_of
from tests.support.trial_servo import TrialServo
from tests.support.truth import Truth
from tests.support.truths_drawn import bench_of, natural_hz

_CHUNK = 8192
"""Ticks between two readings of the rows; the ring holds one more at least."""
_USUAL = (
    "loop.clock=simulated",
    "servo.hand=none",
    "safety.max_speed=1000",
    "safety.engage=at-once",
)


@dataclass(frozen=True, slots=True)
class WallAsked:
    """The requested wall of a trial; its surface is at 0."""

    stiffness: float
    """K [N·m/rad]"""
    damping: float
    """B [N·m·s/rad]"""
    side: Side = "both"
    forced: bool = True
    """Commanded as requested, whatever the guard allows; otherwise the guard decides"""


@dataclass(frozen=True, slots=True)
class Trial:
    """The record of a trial; arrays have one value a tick, shape (n,)."""

    period: float
    """T [s]"""
    output: FloatArray
    """True position of the output [rad]"""
    measured: FloatArray
    """Position by the encoder [rad]"""
    torque: FloatArray
    """Commanded, after the limit [N·m]"""
    stiffness: FloatArray
    """Commanded K [N·m/rad]"""
    damping: FloatArray
    """Commanded B, the injected included [N·m·s/rad]"""
    held: FloatArray
    """Part of the commanded torque that holds a load while the wall is softer [N·m]"""
    state: IntArray
    """State of the detector; see ``haptic_wall.controller.detector.state.State``"""
    saturated: NDArray[np.bool_]
    """The torque was limited"""
    first_alarm_s: float
    """NaN: there was no alarm"""
    trip: str | None
    """Name of the trip that ended the run; None: no trip"""
    oscillation: dict[str, object]
    """The run's report of the oscillation"""
    counts: tuple[int, int, int] = (0, 0, 0)
    """Counts of the backstop: probes, operators found, alarms"""


@dataclass(frozen=True, slots=True)
class Case:
    """All parameters of a trial: its printed text can be run again."""

    preset: str
    truth: Truth
    wall: WallAsked
    duration_s: float = 8.0
    position: float = 0.0
    """Initial displacement of the shaft [rad]"""
    push: float = 0.0
    """Constant torque on the output [N·m]"""
    operator: str = "none"
    """Kind of operator, see ``draw_operator``; not with a push"""
    seed: int = 0
    """Seed of the operator"""
    velocity: float = 0.0
    """Initial velocity of the shaft [rad/s]"""
    struck: float = 0.0
    """Initial velocity that the load behind a transmission has in addition [rad/s]"""
    law: tuple[str, ...] = ()
    """Further changes of the configuration, such as another law than a wall"""

    def moved_by(self) -> Operator:
        """Return the operator that moves the output."""
        if self.push:
            return operator_of(0.0, 0.0, np.zeros(round(self.duration_s * 1e3)), push=self.push)
        return draw_operator(
            self.operator,
            self.truth.inertia,
            self.duration_s,
            np.random.default_rng(self.seed),
            natural_hz=natural_hz(self.truth, self.wall.stiffness),
        )

    def run(self, answer: str = "reduce", operator: Operator | None = None) -> Trial:
        """Run the trial; no speed ends it.

        Args:
            answer: To an oscillation: ``report``, ``reduce`` or ``trip``.
            operator: Moves the output; None: the case's own.
        """
        return run_trial(
            self.truth,
            (*bench_of(self.preset).sets, f"safety.on_oscillation={answer}", *self.law),
            self.wall,
            self.moved_by() if operator is None else operator,
            duration_s=self.duration_s,
            position=self.position,
            velocity=self.velocity,
            struck=self.struck,
        )


@lru_cache(maxsize=64)
def trial_config(sets: tuple[str, ...]) -> Config:
    """Return the configuration of trials, the default preset with changes as ``PATH=VALUE``."""
    return load_config("simulated", [*_USUAL, *sets], runs=True).config


def run_trial(
    truth: Truth,
    sets: Sequence[str],
    wall: WallAsked,
    operator: Operator = NOBODY,
    *,
    duration_s: float,
    position: float = 0.0,
    velocity: float = 0.0,
    struck: float = 0.0,
) -> Trial:
    """Run the tick until the duration is over or a trip ends the run.

    Args:
        truth: The servo.
        sets: The belief and other settings, as ``PATH=VALUE``; see ``trial_config``.
        wall: The rendered wall.
        operator: Holds the output.
        duration_s: [s]
        position: Position of the servo at the start [rad].
        velocity: Velocity of the servo at the start [rad/s].
        struck: Velocity that the load behind a transmission has in addition [rad/s].
    """
    config = _with_wall(trial_config(tuple(sets)), wall)
    clock = SimulatedClock()
    servo = TrialServo(truth, clock, operator, position=position, velocity=velocity, struck=struck)
    telemetry = Telemetry(-1, _CHUNK + 8)
    telemetry.words[Word.HELD_NS] = NO_DEAD_MAN
    known = KnownServo(servo.facts[0], None)
    decided, inbox = _decided(config, known, tuple(sets), wall), Inbox(telemetry)
    axis = assembled(config, known, telemetry, inbox, Shared(), *decided, ())
    cycle = Cycle(clock, servo, [axis], telemetry.words, inbox, config.period_ns, pipelined=False)
    cycle.wall_on()
    blocks: list[NDArray[np.void]] = []
    period_ns, deadline, left, tail = config.period_ns, 0, round(duration_s / config.period_s), 0
    run, wait_until = cycle.run, clock.wait_until
    while left > 0 and cycle.trip is None:
        for _ in range(min(left, _CHUNK)):
            deadline += period_ns
            wait_until(deadline)
            run(deadline, deadline, 0)
            if cycle.trip is not None:
                break
        left -= _CHUNK
        rows, tail = telemetry.read(tail)
        blocks.append(rows[:, 0])
    rows = np.concatenate(blocks)
    backstop = axis.watch.backstop
    return Trial(
        period=config.period_s,
        output=np.array(servo.outputs[: rows.size]),
        measured=rows["position"],
        torque=rows["torque"],
        stiffness=rows["stiffness"],
        damping=rows["damping"],
        held=rows["held_torque"],
        state=rows["oscillation"],
        saturated=(rows["flags"] & FLAG_SATURATED) != 0,
        first_alarm_s=axis.watch.first_alarm_s,
        trip=None if cycle.trip is None else cycle.trip.label,
        oscillation=oscillation_report(axis.watch),
        counts=(backstop.probes, backstop.hands, backstop.alarms),
    )


def _with_wall(config: Config, wall: WallAsked) -> Config:
    """Return the configuration with this wall; not validated again, to save time."""
    for name in ("stiffness", "damping"):
        if not math.isfinite(getattr(wall, name)):
            raise ValueError(f"{name} is {getattr(wall, name)}; give a finite value")
    changed = {
        "stiffness": wall.stiffness,
        "damping": wall.damping,
        "side": wall.side,
        "position": 0.0,
    }
    return config.model_copy(update={"wall": config.wall.model_copy(update=changed)})


def _decided(
    config: Config, servo: KnownServo, sets: tuple[str, ...], wall: WallAsked
) -> tuple[Bins, GainTable]:
    """Return the guard's decisions, or the wall as requested at the guard's delay."""
    if not wall.forced:
        bins = bins_of(config, servo)
        return bins, gain_table(config, bins)
    decision = _decision(sets, servo.facts.torque_limit, servo.facts.counts_per_rev)
    asked = replace(decision, stiffness=wall.stiffness, damping=wall.damping)
    bins = bins_of(config, servo)
    (most,) = most_injected(config, bins.situation, [asked])
    gains = Allowed(asked.stiffness, asked.damping, asked.delay, injected=most)
    bins = replace(bins, ages_ns=[0], intervals_ns=[config.period_ns])
    return bins, GainTable([gains, gains])


@lru_cache(maxsize=64)
def _decision(sets: tuple[str, ...], torque_limit: float, counts_per_rev: int) -> Decision:
    """Return any decision with this belief; its delay, reasons and limits are not used."""
    servo = KnownServo(Facts("a servo", counts_per_rev, torque_limit, 0.0), None)
    config = trial_config(sets)
    return bins_of(config, servo).explained(0)
