"""Measures the ceiling: the virtual damping above which a servo vibrates without any stiffness.

The shaft moves at a constant speed in each direction, with the damper alone. Friction is then
constant, and the vibration after each reversal grows or decays depending on the damping only.
Trials raise the damping until the vibration grows, then concentrate around the damping at which it
neither grows nor decays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.identify.cruise import TURN_S, Cruise, damped_cruises
from haptic_wall.controller.experiments.identify.excitation import Bounds, Guess
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.vibration_growth import (
    Cruised,
    Growing,
    growth_of,
    ringing_hz,
)
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.logs.file import SUFFIX
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.servo import Outcome

SPEED, HALF = 1.5, 0.3
"""Largest speed of a cruise [rad/s]; half its way [rad]"""
_QUANTUM = 0.3
"""Fraction of the torque limit that one encoder count may command at most"""
_SHARE = 0.6
"""Fraction of the torque limit that a cruise may take"""
_LEAST, _RISE, _PER_RUN = 0.02, 1.5, 3
"""First damping over the highest, where no vibration is believed; factor between trials; trials in
a run"""
_BELIEVED = 0.5
"""The same over the believed ceiling"""
_NEAR = ((0.75, 0.9, 1.1, 1.3), (0.88, 0.96, 1.04, 1.12))
"""Dampings of the last two runs, over the estimate"""
_BELOW = (0.2, 0.4, 0.6, 0.8)
"""The same where it is not known yet at which a vibration decays"""
_FAR = 0.6
"""Distance from the estimate, in the logarithm, of trials that count"""
_SURE = 3.0
"""Standard errors by which a vibration must grow"""
_FEWEST = 3


@dataclass(frozen=True, slots=True)
class CeilingTrial:
    """One damping that was tried."""

    virtual_damping: float
    """[N·m·s/rad]"""
    growth_per_s: float | None
    """Growth rate of the vibration's amplitude; None: it was not to be seen [1/s]"""
    stderr: float | None
    frequency_hz: float | None


@dataclass(slots=True)
class CeilingResult:
    """The measured ceiling at one delay."""

    delay_steps: int
    delay_s: float
    """Total [s]"""
    exact: float
    """Ceiling of the belief, with its vibration [N·m·s/rad]"""
    rigid: float
    """Ceiling of the belief without a vibration"""
    measured: float | None = None
    """[N·m·s/rad]"""
    uncertainty: float | None = None
    """Standard error"""
    frequency_hz: float | None = None
    at_least: float | None = None
    """Highest damping at which the vibration still decayed"""
    reason: str | None = None
    trials: list[CeilingTrial] = field(default_factory=list)
    logs: list[str] = field(default_factory=list)

    def report(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return asdict(self)


def ceiling_sweep(
    config: Config, folder: Path, steps: Sequence[int], tell: Callable[[str], None]
) -> list[CeilingResult]:
    """Measure the ceiling at each delay.

    Args:
        config: The servo, without a scripted operator.
        folder: Folder for the logs.
        steps: Inserted delays in periods.
        tell: Called with messages for a person.

    Raises:
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: The servo must be examined.
        UserError: A log could not be written completely.
    """
    bed = Testbed(config, folder, tell)
    return [CeilingSearch(bed, each, tell).run() for each in steps]


class CeilingSearch:
    """Searches for the ceiling at one delay.

    Args:
        bed: The servo.
        delay_steps: Periods inserted.
        tell: Called with each run.
    """

    def __init__(
        self,
        bed: Testbed,
        delay_steps: int,
        tell: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._bed, self._steps, self._tell = bed, delay_steps, tell
        self._device = device = Device.of(bed.config)
        bus = bed.config.servo.kind != "simulated"
        age = max(device.period, bed.config.guard.sample_age) if bus else 0.0
        self._delay = delay_steps * device.period + device.lag + age
        speed = min(SPEED, 0.4 * bed.config.planned_speed)
        self._cruise = Cruise(
            speed=speed,
            half=HALF,
            seconds=2.0 * HALF / speed,
            bias=device.coulomb + device.damping * speed,
            inertia=device.inertia,
            most=_SHARE * device.torque_limit,
        )
        self._played: list[tuple[float, Cruised]] = []
        belief = bed.config.belief()
        self._hertz = belief.flexible_hz.value if belief.is_flexible else None
        self._known: dict[float, CeilingTrial] = {}
        self._trip = ""
        self.result = CeilingResult(
            delay_steps=delay_steps,
            delay_s=self._delay,
            exact=device.ceiling(self._delay),
            rigid=device.rigid_ceiling(self._delay),
        )

    @property
    def top(self) -> float:
        """Return the highest damping that the limits allow [N·m·s/rad]."""
        device, cruise = self._device, self._cruise
        top = (cruise.most - cruise.bias) / cruise.speed
        if device.position_step:
            per_count = device.velocity_samples * device.period / device.position_step
            top = min(top, _QUANTUM * device.torque_limit * per_count)
        return min(top, 1.2 * self.result.rigid)

    def run(self) -> CeilingResult:
        """Search to the end.

        Raises:
            ServoError: The servo could not be started.
            ExperimentInterruptedError: A person has ended it.
            ExperimentTrippedError: The servo must be examined.
            UserError: A log could not be written completely.
        """
        result, cruise = self.result, self._cruise
        if cruise.most <= cruise.bias:
            result.reason = (
                f"friction takes {cruise.bias:.3g} N·m, and a cruise may use {cruise.most:.3g} N·m:"
                " nothing was tried; correct model.coulomb and model.damping, or raise"
                " servo.torque_limit"
            )
            return result
        vibrates = result.exact < result.rigid
        first = min(_BELIEVED * result.exact if vibrates else _LEAST * self.top, self.top)
        grows = self._upward(first)
        if grows is None:
            result.at_least = max((b for b, _ in self._played), default=None)
            result.reason = (
                f"the servo does not vibrate up to {self.top:.3g} N·m·s/rad; above, one encoder"
                " count or the cruise would command too much torque"
            )
            return result
        estimate = grows
        for near in _NEAR:
            self._trials()
            found = self._estimate()
            estimate = estimate if found is None else found[0]
            shares = _BELOW if found is None else near
            if not self._play([share * estimate for share in shares]):
                break
        self._trials()
        self._conclude()
        return result

    def _upward(self, first: float) -> float | None:
        """Raise the damping until a vibration grows; return that damping, or None."""
        damping = first
        while True:
            batch = [damping * _RISE**n for n in range(_PER_RUN)]
            batch = [b for b in batch if b <= self.top] or [self.top]
            if not self._play(batch):
                return batch[0]
            grown = [t for t in self._trials() if _grows(t)]
            if grown:
                self._hertz = grown[-1].frequency_hz
                self._known.clear()
                return min(t.virtual_damping for t in grown)
            if batch[-1] >= self.top:
                return None
            damping = min(batch[-1] * _RISE, self.top)

    def _play(self, dampings: Sequence[float]) -> bool:
        """Try some dampings in one run; return whether the run was completed."""
        cruise, device = self._cruise, self._device
        bounds = Bounds(
            reach=2.0 * HALF,
            torque=device.torque_limit,
            speed=cruise.speed,
            step=device.position_step,
            period=device.period,
        )
        guess = Guess(device.inertia, device.damping, device.coulomb, self._delay)
        if self._hertz is not None:
            cruise = replace(cruise, turn=self._ringing_turn(self._hertz))
        phases = damped_cruises(cruise, dampings, guess, bounds)
        name = f"ceiling-n{self._steps}-{len(self.result.logs) + 1}"
        self._tell(
            f"cruises with a virtual damping of {dampings[0]:.3g} to {dampings[-1]:.3g} N·m·s/rad"
        )
        self.result.logs.append(f"{name}{SUFFIX}")
        try:
            played = self._bed.play(name, phases, self._steps)
        except ExperimentTrippedError as error:
            if not error.of_motion:
                raise
            self._trip = f"{error.stop_reason}: {error}"
            self._tell(self._trip)
            return False
        rows = played.rows[played.rows["outcome"] == Outcome.OK]
        for number, phase in enumerate(phases):
            if phase.damping > 0.0 and phase.bias != 0.0:
                here = rows[rows["phase"] == number]
                time = (here["sampled_ns"] - here["sampled_ns"][:1]) * 1e-9
                way = math.copysign(1.0, phase.bias)
                each = Cruised(time, here["position"].copy(), way, device.position_step)
                self._played.append((phase.damping, each))
        return True

    def _ringing_turn(self, hertz: float) -> float:
        """Return the duration of a reversal after which a vibration remains [s]."""
        shortest = 2.0 * self._device.inertia * self._cruise.speed / self._cruise.most
        turns = (0.82, 1.43, 2.46, 3.47, 4.48)  # periods: the residual of a rectangular pulse
        return next((n / hertz for n in turns if n / hertz >= shortest), TURN_S)

    def _trials(self) -> list[CeilingTrial]:
        """Return a trial for each damping, with the growth rate from all of its cruises."""
        dampings = sorted({b for b, _ in self._played})
        hertz = self._hertz
        if hertz is None:  # the highest damping shows it best
            hertz = ringing_hz([each for b, each in self._played if b == dampings[-1]])
        for damping in dampings:
            if self._hertz is None or damping not in self._known:
                cruises = [each for b, each in self._played if b == damping]
                self._known[damping] = _trial(damping, growth_of(cruises, hertz))
        self.result.trials = [self._known[b] for b in dampings]
        return self.result.trials

    def _estimate(self) -> tuple[float, float, float] | None:
        """Return the damping without growth, its standard error, and the frequency."""
        known = [t for t in self.result.trials if t.growth_per_s is not None]
        grew = [t.virtual_damping for t in known if _grows(t)]
        died = [t.virtual_damping for t in known if (t.growth_per_s or 0.0) < 0.0]
        died = [b for b in died if b < min(grew, default=0.0)]
        if not grew or not died:
            return None
        around = math.sqrt(min(grew) * max(died))
        near = [t for t in known if abs(math.log(t.virtual_damping / around)) < _FAR]
        if len(near) < _FEWEST:
            return None
        x = np.array([t.virtual_damping / around for t in near])
        y = np.array([t.growth_per_s or 0.0 for t in near])
        weights = 1.0 / np.array([max(t.stderr or 0.0, 1e-3) for t in near])
        return _zero(x, y, weights, around, np.array([t.frequency_hz or 0.0 for t in near]))

    def _conclude(self) -> None:
        result, found = self.result, self._estimate()
        decayed = [
            t.virtual_damping
            for t in result.trials
            if t.growth_per_s is not None and t.growth_per_s < 0.0
        ]
        result.at_least = max(decayed, default=None)
        if found is None and self._trip and not any(_grows(t) for t in result.trials):
            result.reason = f"a run ended early, and no vibration was seen to grow: {self._trip}"
            return
        if found is None:
            result.reason = "a vibration grows, but too few trials determine its onset"
            return
        result.measured, result.uncertainty, result.frequency_hz = found


def _grows(trial: CeilingTrial) -> bool:
    """Return whether a vibration surely grows."""
    return trial.growth_per_s is not None and trial.growth_per_s > _SURE * (trial.stderr or 0.0)


def _trial(damping: float, found: Growing | None) -> CeilingTrial:
    if found is None:
        return CeilingTrial(damping, None, None, None)
    return CeilingTrial(damping, found.per_s, found.stderr, found.hertz)


def _zero(
    x: FloatArray, y: FloatArray, weights: FloatArray, around: float, hertz: FloatArray
) -> tuple[float, float, float] | None:
    """Return the zero of a line through the growth rates, its standard error, and the frequency."""
    columns = np.column_stack([np.ones_like(x), x - 1.0]) * weights[:, None]
    found, *_ = np.linalg.lstsq(columns, y * weights, rcond=None)
    if found[1] <= 0.0:
        return None
    root = 1.0 - found[0] / found[1]
    left = y * weights - columns @ found
    variance = max(float(left @ left) / max(x.size - 2, 1), 1.0)
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    gradient = np.array([1.0, root - 1.0]) / found[1]
    error = math.sqrt(float(gradient @ covariance @ gradient))
    if not 0.3 < root < 3.0:
        return None
    return float(around * root), float(around * error), float(np.median(hertz))
