"""Measures the critical stiffness of a servo: releases it at many stiffnesses, fits the growth.

For each trial a soft spring moves the shaft to the kick and lets it rest. Then the wall itself,
about the starting position, takes over, and the growth of the first cycles is measured. Trials
bracket the limit, then concentrate around it until it is known well enough. One run holds a batch
of trials, so that there is one start-up for all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.holding import sample_age
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.growth_fit import Balance
from haptic_wall.controller.experiments.sweep.plan import (
    KICK,
    Options,
    PlanePoint,
    reach,
    soft_phase,
    soft_spring,
    trial_phase,
)
from haptic_wall.controller.experiments.sweep.result import (
    PointResult,
    bracket_text,
    nothing_text,
    out_of_reach_text,
    unstable_text,
)
from haptic_wall.controller.experiments.sweep.trial_watch import Seen, watch
from haptic_wall.controller.experiments.sweep.trials import Trials, around, is_close, is_enough
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed, recorded
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.logs.file import SUFFIX

_BACK = 0.6
"""Factor on a stiffness that tripped, for the next start"""
_SOFTEST = 1e-2
"""Lower end of the search, in predicted stiffnesses"""
_BATCHES = 14
_TRIPS = 3
"""Number of trips by overspeed or oscillation that end a point; other trips end the search"""
_MOST_OFFSET = 2.0
"""Largest offset of the soft spring's centre from its goal, in kicks, or ``KICK``"""
_IDLE = 4
"""Number of batches without a new half-cycle to fit that end the search"""
_SMALLER, _LEAST_COUNTS = 0.5, 8.0
"""Factor on a kick at which nothing grew within the torque limit, and the smallest in counts"""
_CORRECTED, _STUCK = 0.7, 1.5
"""Factor on a miss that the next kick from that side corrects; on that of a shaft that stuck"""
_STARTED = 0.6, 1.5
"""Least and largest start of a trial, over its kick: a shaft that stuck is not let go"""


@dataclass(frozen=True, slots=True)
class _Asked:
    stiffness: float
    sign: float
    aim: float
    """Wanted start, unsigned [rad]"""


class PointSearch:
    """Searches for the critical stiffness at one point.

    Args:
        bed: The servo.
        setting: The point.
        options: Kick and tolerance.
        tell: Called with each trial.
    """

    def __init__(
        self,
        bed: Testbed,
        setting: PlanePoint,
        options: Options,
        tell: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._bed, self._setting, self._options, self._tell = bed, setting, options, tell
        self._device = Device.of(bed.config)
        self._longest_age = sample_age(bed.config)
        self._ages: list[float] = []
        self._cap = math.inf
        self._too_stiff = self._lost = self._made = 0
        self.result = PointResult(
            setting.virtual_damping, setting.delay_steps, 0.0, 0.0, 0.0, options.kick
        )
        self._locate()

    def _locate(self) -> None:
        """Set the total delay, by the ages that were measured, and theory's limits at it."""
        result, device = self.result, self._device
        age = float(np.mean(self._ages)) if self._ages else 0.5 * self._longest_age
        result.delay_s = self._setting.delay_steps * device.period + device.lag + age
        result.exact = device.exact(result.virtual_damping, result.delay_s)
        result.linear = device.linear(result.virtual_damping, result.delay_s)

    def run(self) -> PointResult:
        """Search to the end.

        Raises:
            ServoError: The servo could not be started.
            ExperimentInterruptedError: A person has ended it.
            ExperimentTrippedError: A trip has ended it, after which the servo must be examined.
            UserError: A log could not be written completely.
        """
        result = self.result
        if result.exact <= 0.0:
            loop, damping = self._device.loop, result.virtual_damping
            result.reason = unstable_text(loop, damping, result.delay_s)
            return result
        self._kick_by(self._options.kick)
        self._hold = soft_spring(self._bed.config, self._device, self._setting.delay_steps)
        if self._reach.top <= _SOFTEST * self._reach.predicted:
            result.reason = out_of_reach_text(self._reach, "nothing was tried")
            return result
        found = self._search()
        while found is None and self._may_be_smaller():
            # A stiffer wall oscillates faster, against the same friction. Friction that grows with
            # the torque, or a dead band, is not in the belief.
            self._kick_by(_SMALLER * self._kick)
            self._tell(
                f"nothing grows within the torque limit: a smaller kick, {self._kick:.3g} rad"
            )
            found = self._search()
        self._locate()
        self._conclude(found)
        return result

    def _kick_by(self, kick: float | None) -> None:
        """Begin with a kick, or with the largest that the limits allow."""
        self._reach = reach(self._device, self._setting, self.result.delay_s, kick)
        self._kick = self.result.kick_rad = self._reach.kick
        self._trials = Trials(self._kick)
        self._offset = {1.0: 0.0, -1.0: 0.0}

    def _may_be_smaller(self) -> bool:
        """Whether the torque limit was in the way, and a smaller kick leaves more room."""
        chosen = self._options.kick is None and self._too_stiff == 0
        least = _LEAST_COUNTS * self._device.position_step
        few = self._trials.died and not self._trials.grew
        return bool(chosen and few and _SMALLER * self._kick > least)

    def _search(self) -> Balance | None:
        """Return the balance of one kick; None: its trials do not tell it."""
        trials, options = self._trials, self._options
        fine = idle = 0
        for _ in range(_BATCHES):
            found = trials.estimate()
            if idle == _IDLE:
                break
            if trials.is_narrow if found is None else is_enough(found, fine, options.tolerance):
                break
            fine += is_close(found)
            if found is not None:
                batch = self._possible(around(found))
            else:
                first = self._reach.predicted if self._cap == math.inf else _BACK * self._cap
                batch = self._possible(trials.following(first, min(self._reach.top, self._cap)))
            usable = trials.usable
            if not batch or not self._play(batch):
                break
            idle = idle + 1 if trials.usable == usable else 0
        return trials.estimate()

    def _possible(self, wanted: Sequence[float]) -> list[_Asked]:
        """Return trials at the stiffnesses within reach, softest first.

        They are on alternating sides, at slightly different places.
        """
        lowest, highest = _SOFTEST * self._reach.predicted, min(self._reach.top, self._cap)
        step = max(self._device.position_step, 0.02 * self._kick)
        asked = []
        for stiffness in sorted({k for k in wanted if lowest <= k <= highest}):
            self._made += 1
            # The golden ratio spreads any number of places evenly.
            dither = (self._made * 0.618034) % 1.0 - 0.5
            sign = 1.0 if self._made % 2 else -1.0
            asked.append(_Asked(stiffness, sign, self._kick + dither * step))
        return asked

    # One batch

    def _play(self, batch: Sequence[_Asked]) -> bool:
        """Run a batch of trials; return whether to continue."""
        setting, result, kick = self._setting, self.result, self._kick
        phases: list[Phase] = []
        for asked in batch:
            centre = asked.sign * (asked.aim + self._offset[asked.sign])
            phases += [
                soft_phase(self._hold, self._device, centre, kick),
                trial_phase(self._device, setting, result.delay_s, asked.stiffness, kick),
            ]
        # Back to the start: the next batch begins where this one leaves the shaft.
        phases.append(soft_phase(self._hold, self._device, 0.0, kick))
        name = f"B{setting.virtual_damping:g}-n{setting.delay_steps}-{len(result.logs) + 1}"
        soft, stiff = batch[0].stiffness, max(asked.stiffness for asked in batch)
        self._tell(
            f"B {setting.virtual_damping:g}, {setting.delay_steps} steps: {len(batch)} trials from"
            f" {soft:.4g} to {stiff:.4g} N·m/rad"
        )
        tripped: ExperimentTrippedError | None = None
        result.logs.append(f"{name}{SUFFIX}")
        try:
            played = self._bed.play(name, phases, setting.delay_steps)
            rows = played.rows
            if played.repeated is not None:
                result.trips.append(f"{played.repeated} in {name}, which was repeated")
        except ExperimentTrippedError as error:
            rows = recorded(self._bed.folder / f"{name}{SUFFIX}")
            unknown = error.fault is not None and not error.passing  # which stiffness it was
            if error.gone or (unknown and not rows.size):
                raise
            tripped = error
            if unknown and error.fault:
                raise UserError(error.fault) from error
            rows = rows[:0] if error.fault else rows
        over = int(rows["phase"][-1]) if rows.size else -1
        missed: dict[float, list[float]] = {1.0: [], -1.0: []}
        for n, asked in enumerate(batch):
            phase = 2 * n + 1
            if phase > over or (tripped is not None and phase == over):
                break
            seen = watch(rows, phase, phases[phase], self._device, kick)
            if seen is not None:
                missed[asked.sign].append(self._take(seen, asked))
            elif (released := rows["position"][rows["phase"] == phase]).size:
                # Beyond its reach at once: noise shakes friction loose, which held it elsewhere.
                start = asked.sign * float(released[0] - rows["position"][0])
                missed[asked.sign].append(asked.aim - start)
        # Friction and gravity keep the shaft from the spring's centre, so the next trial aims
        # beside it. The offset is limited: a shaft that friction holds does not follow any aim.
        most = max(_MOST_OFFSET * kick, KICK)
        for sign, ways in missed.items():
            offset = self._offset[sign] + float(np.mean(ways or [0.0]))
            self._offset[sign] = max(-most, min(most, offset))
        if tripped is not None:
            self._blame(tripped, batch[min(max(over, 0) // 2, len(batch) - 1)].stiffness)
        self._locate()
        return self._too_stiff < _TRIPS

    def _blame(self, tripped: ExperimentTrippedError, stiffness: float) -> None:
        """Count a trip; raise the last one that the wall did not cause."""
        self.result.trips.append(f"{tripped.stop_reason} at {stiffness:.4g} N·m/rad")
        if tripped.of_motion:
            self._too_stiff += 1
            self._cap = min(self._cap, 0.999 * stiffness)
            return
        self._lost += 1
        if self._lost == _TRIPS:
            raise tripped

    def _take(self, seen: Seen, asked: _Asked) -> float:
        """Keep a trial that began at its kick; return how far the next one must aim further."""
        if seen.age is not None:
            self._ages.append(seen.age)
        start = asked.sign * seen.start
        low, high = _STARTED
        if low * asked.aim <= start <= high * asked.aim:
            if seen.disturbed:
                self.result.disturbed += 1
            else:
                self._trials.made.append(seen.trial)
        return (_CORRECTED if start >= low * asked.aim else _STUCK) * (asked.aim - start)

    # The end

    def _conclude(self, found: Balance | None) -> None:
        result, device = self.result, self._device
        damping, delay = result.virtual_damping, result.delay_s
        trials, result.trials = self._trials, len(self._trials.made)
        if self._too_stiff >= _TRIPS:
            result.reason = f"given up after {_TRIPS} trips: {'; '.join(result.trips)}"
        elif found is not None:
            result.measured, result.uncertainty = found.stiffness, found.uncertainty
            result.frequency_hz = found.frequency if math.isfinite(found.frequency) else None
            result.kick_rad = found.amplitude
            if result.exact > 0.0:
                result.predicted_with_friction = device.sustained(damping, delay, found.amplitude)
            if not found.low <= found.stiffness <= found.high:
                result.reason = "extrapolated: on one side of the limit there is no trial"
            elif found.uncertainty > 2.0 * self._options.tolerance * found.stiffness:
                result.reason = "the trials differ by more than the tolerance: see the uncertainty"
        elif (between := trials.range()) is not None:
            result.measured = math.sqrt(between[0] * between[1])
            result.uncertainty = 0.5 * (between[1] - between[0])
            result.reason = bracket_text(*between, mixed=between[1] not in trials.grew)
        else:
            result.reason = nothing_text(self._reach, trials.died, trials.grew, self._cap, result)
