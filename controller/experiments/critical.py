"""The critical stiffness of whatever servo there is: let go at many stiffnesses, watched each time.

For each trial a soft spring moves the shaft to the kick and lets it come to rest; then the wall
itself, about the place where all began, takes over, and what the motion does in its first cycles is
measured. Trials bracket the limit, then crowd about it until it is known well enough. One run holds
a batch of trials, so that a start-up is paid once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controller.experiments.decrement import Growth, growth, turning_points
from controller.experiments.growth_fit import Balance, Trial, balance
from controller.experiments.sweep_plan import (
    Device,
    Options,
    Reach,
    Setting,
    hold_spring,
    reach,
    trial_phase,
)
from controller.experiments.testbed import ExperimentTrippedError, Testbed
from controller.logfile import SUFFIX, read_log
from controller.program import Phase
from controller.telemetry import FLAG_WARM_UP
from hw.servo import Outcome

_FIRST = (0.6, 0.8, 1.0, 1.25)
_STIFFER = (1.2, 1.5, 1.9, 2.5)
_SOFTER = (0.3, 0.5, 0.7, 0.85)
_BETWEEN = (0.05, 0.35, 0.65, 0.95)
_BACK = 0.6
"""Where to begin again below a stiffness that tripped"""
_AROUND = (-1.0, -0.4, 0.4, 1.0)
_COARSE, _FINE = 0.12, 0.04
"""Half width of a batch about an estimate, of the stiffness' logarithm"""
_SOFTEST = 1e-2
"""Where the search ends below, in predicted stiffnesses"""
_BATCHES, _MOST_FINE = 12, 4
_TRIPS = 3
_IDLE = 4
"""Batches without one more half cycle to fit, after which it makes no sense to go on"""
_DISTURBED, _HOPELESS = 0.03, 0.2
"""Share of lost, late or skipped periods, or of saturated ones, that a half cycle may have; where
most have more, the better half of them, up to the second"""
_AGE = 1.0, 2.0
"""Sample age in periods that is reckoned with before it is measured: immediate, pipelined"""
_NOISE_COUNTS = 2.5
_NOISE_SHARE = 0.002


@dataclass(slots=True)
class PointResult:
    """One measured point; what is not known is None."""

    virtual_damping: float
    delay_steps: int
    delay_s: float
    """Total: inserted, the device's own as believed, and the measured age of the samples"""
    exact: float
    """Without friction, for the believed servo [N·m/rad]; 0: nothing is stable"""
    linear: float
    kick_rad: float | None
    """Amplitude at which growth is zero"""
    measured: float | None = None
    """[N·m/rad]"""
    uncertainty: float | None = None
    """Standard error [N·m/rad]"""
    frequency_hz: float | None = None
    predicted_with_friction: float | None = None
    """Stiffness whose onset amplitude is the kick, for the believed friction [N·m/rad]"""
    onset_rad: float | None = None
    """Onset amplitude at the measured stiffness; None: below the limit nothing grows"""
    trials: int = 0
    reason: str | None = None
    """Why there is no figure, or what is to be known of it"""
    trips: list[str] = field(default_factory=list)
    logs: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Asked:
    stiffness: float
    sign: float
    aim: float
    """Centre of the soft spring, without its sign [rad]"""


class PointSearch:
    """Looks for the critical stiffness at one point.

    Args:
        bed: The servo.
        setting: The point.
        options: Kick, repeats, tolerance.
        tell: Called with what is tried.
    """

    def __init__(
        self,
        bed: Testbed,
        setting: Setting,
        options: Options,
        tell: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._bed = bed
        self._setting = setting
        self._options = options
        self._tell = tell
        self._device = Device.of(bed.config)
        config = bed.config
        bus = config.servo.kind != "simulated"
        self._longest_age = 0.0
        if bus:
            periods = _AGE[config.servo.schedule == "pipelined"]
            self._longest_age = max(periods * config.period_s, config.guard.sample_age)
        self._ages: list[float] = []
        self._delay = self._total_delay()
        self._trials: list[Trial] = []
        self._cap = math.inf
        self._offset = {1.0: 0.0, -1.0: 0.0}
        self._repeat = 0
        self.result = PointResult(
            virtual_damping=setting.virtual_damping,
            delay_steps=setting.delay_steps,
            delay_s=self._delay,
            exact=self._device.exact(setting.virtual_damping, self._delay),
            linear=self._device.linear(setting.virtual_damping, self._delay),
            kick_rad=options.kick,
        )

    def run(self) -> PointResult:
        """Search to the end.

        Raises:
            ServoError: The servo could not be started.
            ExperimentInterruptedError: A person has ended it.
            UserError: A log could not be kept.
        """
        result = self.result
        damping = self._setting.virtual_damping
        if result.exact <= 0.0:
            result.reason = self._unstable_text()
            return result
        self._reach = reach(self._device, self._setting, self._delay, self._options.kick)
        self._kick = self._reach.kick
        result.kick_rad = self._kick
        self._hold = hold_spring(
            self._device, self._setting.delay_steps, self._longest_age, self._kick
        )
        if self._reach.top <= _SOFTEST * self._reach.predicted:
            result.reason = self._out_of_reach_text("nothing was tried")
            return result
        found: Balance | None = None
        fine = idle = 0
        for number in range(_BATCHES):
            found = self._estimate()
            if found is not None and self._enough(found, fine):
                break
            near = found is not None and self._near(found)
            batch = self._around(found, near) if found is not None else self._bracketing()
            if not batch:
                break
            fine += near
            usable = len(self._usable())
            if not self._play(number, batch):
                break
            idle = idle + 1 if len(self._usable()) == usable else 0
            if idle == _IDLE:
                break
        found = self._estimate()
        self._conclude(found, damping)
        return result

    def _usable(self) -> list[Trial]:
        """Those with half cycles to fit, or whose end says enough to go by."""
        return [trial for trial in self._trials if trial.growth.log_ratio.size]

    def _total_delay(self) -> float:
        inserted = self._setting.delay_steps * self._device.period
        guess = 0.5 * self._longest_age
        age = float(np.mean(self._ages)) if self._ages else guess
        return inserted + self._device.lag + age

    # What to try next

    def _near(self, found: Balance) -> bool:
        """Whether an estimate is good enough to crowd about it."""
        return found.high / found.low < math.exp(3.0 * _COARSE)

    def _around(self, found: Balance, near: bool) -> list[_Asked]:
        half, repeats = (_FINE, self._options.repeats) if near else (_COARSE, 1)
        return self._possible([found.stiffness * math.exp(half * x) for x in _AROUND], repeats)

    def _bracketing(self) -> list[_Asked]:
        """Trials toward the side that was not seen yet, or between the two."""
        highest = min(self._reach.top, self._cap)
        grew = [trial.stiffness for trial in self._trials if trial.grew]
        died = [trial.stiffness for trial in self._trials if not trial.grew]
        if not self._trials:
            first = self._reach.predicted if self._cap == math.inf else _BACK * self._cap
            first = min(first, highest / _FIRST[-2])
            return self._possible([first * factor for factor in _FIRST], 1)
        if not grew:
            if max(died) > 0.999 * highest:
                return []
            return self._possible([min(max(died) * x, highest) for x in _STIFFER], 1)
        if not died:
            return self._possible([min(grew) * factor for factor in _SOFTER], 1)
        ends = sorted([min(grew), max([k for k in died if k < min(grew)], default=min(died))])
        ratio = max(ends[1] / ends[0], 1.02)
        return self._possible([ends[0] * ratio**share for share in _BETWEEN], 1)

    def _possible(self, wanted: Sequence[float], repeats: int) -> list[_Asked]:
        """Those within reach, each once, or as often as repeated."""
        lowest = _SOFTEST * self._reach.predicted
        highest = min(self._reach.top, self._cap)
        return self._asked({k for k in wanted if lowest <= k <= highest}, repeats)

    def _asked(self, stiffnesses: set[float], repeats: int) -> list[_Asked]:
        """Softest first, from either side in turn, never twice from quite the same place."""
        asked = []
        for _ in range(repeats):
            for stiffness in sorted(stiffnesses):
                self._repeat += 1
                sign = 1.0 if self._repeat % 2 else -1.0
                # The golden ratio spreads the places evenly, whatever their number.
                dither = (self._repeat * 0.618034) % 1.0 - 0.5
                step = max(self._device.position_step, 0.02 * self._kick)
                asked.append(_Asked(stiffness, sign, self._kick + dither * step))
        return asked

    def _enough(self, found: Balance, fine: int) -> bool:
        if fine == 0 or not found.low <= found.stiffness <= found.high:
            return False
        return found.uncertainty <= self._options.tolerance * found.stiffness or fine >= _MOST_FINE

    def _estimate(self) -> Balance | None:
        grew = [trial.stiffness for trial in self._trials if trial.grew]
        died = [trial.stiffness for trial in self._trials if not trial.grew]
        if not grew or not died:
            return None
        if len(grew) + len(died) > 4:
            # Where most of the softer die and most of the stiffer grow.
            guess = math.sqrt(_middle(sorted(died)[-3:]) * _middle(sorted(grew)[:3]))
        else:
            guess = math.sqrt(max(died) * min(grew))
        return balance(self._trials, self._kick, guess)

    # One batch

    def _play(self, number: int, batch: Sequence[_Asked]) -> bool:
        """Play a batch of trials; whether to go on."""
        setting, result = self._setting, self.result
        phases: list[Phase] = []
        for asked in batch:
            centre = asked.sign * (asked.aim + self._offset[asked.sign])
            phases.append(self._hold.phase(centre, asked.sign, self._kick))
            phases.append(
                trial_phase(self._device, setting, self._delay, asked.stiffness, self._kick)
            )
        name = f"B{setting.virtual_damping:g}-n{setting.delay_steps}-{number + 1}"
        soft, stiff = batch[0].stiffness, max(asked.stiffness for asked in batch)
        self._tell(
            f"B {setting.virtual_damping:g}, {setting.delay_steps} steps: {len(batch)} trials from"
            f" {soft:.4g} to {stiff:.4g} N·m/rad"
        )
        tripped: str | None = None
        result.logs.append(f"{name}{SUFFIX}")
        try:
            rows = self._bed.play(name, phases, setting.delay_steps).rows
        except ExperimentTrippedError as error:
            tripped = error.stop_reason
            rows = _rows_of(self._bed.folder / f"{name}{SUFFIX}")
        over = int(rows["phase"][-1]) if rows.size else -1
        for n, asked in enumerate(batch):
            phase = 2 * n + 1
            if phase > over or (tripped is not None and phase == over):
                break
            self._watch(rows, phases[phase], phase, asked)
        if tripped is not None:
            culprit = batch[min(max(over, 0) // 2, len(batch) - 1)]
            result.trips.append(f"{tripped} at {culprit.stiffness:.4g} N·m/rad")
            self._cap = min(self._cap, 0.999 * culprit.stiffness)
        self._delay = self._total_delay()
        return len(result.trips) < _TRIPS

    def _watch(self, rows: NDArray[np.void], phase: Phase, number: int, asked: _Asked) -> None:
        """Take in what one trial did."""
        own = rows[rows["phase"] == number]
        if own.size < 3:
            return
        origin = float(rows["position"][0])
        good = own["outcome"] == Outcome.OK
        time = (own["sampled_ns"] - own["sampled_ns"][0]) * 1e-9
        position = own["position"] - origin
        started = asked.sign * float(position[0])
        self._offset[asked.sign] += 0.7 * (asked.aim - started)
        least = _NOISE_COUNTS * self._device.position_step
        least = max(least, _NOISE_SHARE * self._kick * (0.1 if least == 0.0 else 1.0))
        turns = turning_points(time[good], position[good], least)
        sound = self._sound(own, phase, position, time, turns.time)
        found = growth(turns, sound)
        if sound.any():
            used = sound[np.clip(np.searchsorted(turns.time, time) - 1, 0, sound.size - 1)]
            self._ages.append(_mean_age(own, used, self._device.period))
        self._trials.append(
            Trial(asked.stiffness, found, turns.half_period, _grew(found, turns.position, position))
        )

    def _sound(
        self,
        own: NDArray[np.void],
        phase: Phase,
        position: NDArray[np.float64],
        time: NDArray[np.float64],
        turned: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Which half cycles nothing disturbed: no loss, no stall, no saturation."""
        asked = -phase.stiffness * position - phase.damping * own["velocity"]
        scale = 1e-9 * (1.0 + np.abs(asked))
        # Once more half a count off: what the torque limit cut differs by more.
        cut = np.abs(asked - own["wall_torque"]) > scale
        wrong = cut + (own["outcome"] != Outcome.OK) + own["missed"]
        total = np.concatenate([[0.0], np.cumsum(wrong)])
        at = np.clip(np.searchsorted(time, turned), 0, own.size)
        share = np.diff(total[at]) / np.maximum(np.diff(turned) / self._device.period, 1.0)
        usual = float(np.median(share)) if share.size else 0.0
        result: NDArray[np.bool_] = share <= min(max(usual, _DISTURBED), _HOPELESS)
        return result

    # The end

    def _conclude(self, found: Balance | None, damping: float) -> None:
        result, device = self.result, self._device
        result.trials = len(self._trials)
        result.delay_s = self._delay
        result.exact = device.exact(damping, self._delay)
        result.linear = device.linear(damping, self._delay)
        if len(result.trips) >= _TRIPS:
            result.reason = f"given up after {_TRIPS} trips: {'; '.join(result.trips)}"
            return
        if found is None:
            result.reason = self._nothing_text()
            return
        result.measured = found.stiffness
        result.uncertainty = found.uncertainty
        result.frequency_hz = found.frequency if math.isfinite(found.frequency) else None
        result.kick_rad = found.amplitude
        if result.exact > 0.0:
            again = reach(device, self._setting, self._delay, found.amplitude)
            result.predicted_with_friction = again.predicted
            onset, _ = device.onset(np.array([found.stiffness]), damping, self._delay)
            result.onset_rad = float(onset[0]) if np.isfinite(onset[0]) else None
        if not found.low <= found.stiffness <= found.high:
            result.reason = "extrapolated: no trial on one of its sides"
        elif found.uncertainty > 2.0 * self._options.tolerance * found.stiffness:
            result.reason = "trials differ by more than the tolerance: see the uncertainty"

    def _unstable_text(self) -> str:
        ceiling = self._device.ceiling(self._delay)
        damping = self._setting.virtual_damping
        if damping >= ceiling:
            return (
                f"virtual damping {damping:g} is over the ceiling {ceiling:.4g} N·m·s/rad at this"
                " delay: no stiffness is stable; nothing was tried"
            )
        return (
            f"virtual damping {damping:g} takes away all of the servo's own"
            f" {self._device.damping:g} N·m·s/rad: no stiffness is stable; nothing was tried"
        )

    def _nothing_text(self) -> str:
        died = [trial.stiffness for trial in self._trials if not trial.grew]
        grew = [trial.stiffness for trial in self._trials if trial.grew]
        if died and not grew:
            if self._cap < self._reach.top:
                return (
                    f"did not grow below the stiffness that tripped: {'; '.join(self.result.trips)}"
                )
            return self._out_of_reach_text(f"motion still died at {max(died):.4g} N·m/rad")
        if grew and not died:
            return (
                f"motion grew at every stiffness down to {min(grew):.4g} N·m/rad: the believed"
                " servo (model.*) is far from this one, or something else moves it"
            )
        if not self._trials:
            return "no trial could be watched to its end"
        return "too few undisturbed half cycles to tell growth from decay"

    def _out_of_reach_text(self, seen: str) -> str:
        edge: Reach = self._reach
        return (
            f"{edge.bound_by} leaves room up to {edge.top:.4g} N·m/rad for a kick of"
            f" {edge.kick:.4g} rad, the limit is expected at {edge.predicted:.4g}; {seen}: use a"
            f" smaller --kick or raise {edge.bound_by}"
        )


def _middle(values: Sequence[float]) -> float:
    return float(np.median(values))


def _grew(found: Growth, turned: NDArray[np.float64], position: NDArray[np.float64]) -> bool:
    """Whether the motion of a trial grew, as far as can be told."""
    if found.log_ratio.size:
        return bool(np.mean(found.log_ratio[:6]) > 0.0)
    start = abs(float(position[0]))
    if turned.size > 2:
        return abs(float(turned[-1])) > abs(float(turned[1]))
    return bool(np.max(np.abs(position)) > 1.2 * start)


def _mean_age(own: NDArray[np.void], used: NDArray[np.bool_], period: float) -> float:
    """Age of the sample behind the torque, averaged over the time in which each torque acts [s].

    A lost sample leaves an older one in force, a skipped period an older torque.
    """
    held = np.append(1.0 + own["missed"][1:], 1.0) * used
    stale = own["age_ns"] * 1e-9 + 0.5 * period * (held - 1.0)
    return float(np.sum(held * stale) / np.sum(held))


def _rows_of(log: Path) -> NDArray[np.void]:
    """What a run recorded before it tripped."""
    _, rows = read_log(log)
    if rows.size == 0:
        return rows
    on: NDArray[np.void] = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
    return on
