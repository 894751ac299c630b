"""Plans torque steps of both signs within a small travel, and finds their windows in a log.

The torque alternates, so that the shaft oscillates: each change occurs where the shaft is fastest,
far from where friction changes its sign. Lengths and amplitudes are a seeded random sequence: no
two steps have the same rounding errors, and a lag longer than a step cannot be mistaken for a
shorter one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.holding import Hold
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

TRAVEL = 0.12
"""Angle between reversals at the planned torque [rad]."""
SHARE = 0.4
"""Largest fraction of the torque limit."""
FRICTION = 2.5
"""Least ratio of the torque to the highest believed friction; below, friction dominates the motion.
"""
SHORTEST = 24
"""Least number of periods in a step: enough samples on either side."""
SPEED_SHARE = 0.4
"""Largest planned fraction of ``safety.max_speed``."""
PER_BURST = 20
"""Steps between two returns to the centre."""
_SPREAD, _AMPLITUDES = 0.25, 0.15
"""Largest relative variation of the steps in speed and amplitude."""
_REST_S, _RETURN_S = 0.1, 1.5
_INSIDE = 0.15
"""Fraction of the motion between switch and reversal omitted at the reversal: there friction
reverses, and backlash is taken up."""
_FEWEST = 5
"""Least number of samples on each side of a usable step."""


@dataclass(frozen=True, slots=True)
class StepPlan:
    """The plan of torque steps."""

    torque: float
    """Mean amplitude [N·m]"""
    seconds: float
    """Mean length of a step [s]"""
    travel: float
    """Angle between reversals, at the lowest believed inertia [rad]"""
    speed: float
    """Highest speed, at the lowest believed inertia [rad/s]"""
    reach: float
    """Distance from the centre at which a burst ends [rad]"""


def plan_steps(config: Config, torque_limit: float, hold: Hold) -> StepPlan:
    """Return torque and length of steps that suit the belief about a servo.

    Args:
        config: The effective configuration.
        torque_limit: [N·m].
        hold: The spring that brings the shaft back between bursts.

    Raises:
        UserError: Friction may be too large for the torque limit.
    """
    belief, period = config.belief(), config.period_s
    shortest = SHORTEST * period
    inertia = belief.inertia.low / belief.torque_gain.high
    fastest = min(4.0 * TRAVEL / shortest**2, 2.0 * SPEED_SHARE * config.planned_speed / shortest)
    torque = min(SHARE * torque_limit, inertia * fastest + belief.coulomb.high)
    friction = belief.coulomb.high / belief.torque_gain.low
    if torque < FRICTION * friction:
        raise UserError(
            f"the steps may have {torque:.3g} N·m ({SHARE:.0%} of the torque limit), wanted at"
            f" least {FRICTION:g} times the believed friction of up to {friction:.3g} N·m",
            advice="raise servo.torque_limit, or narrow model.coulomb",
        )
    acceleration = torque / inertia
    seconds = max(shortest, math.sqrt(4.0 * TRAVEL / acceleration))
    speed = acceleration * seconds / 2.0
    if speed > SPEED_SHARE * config.planned_speed:
        seconds *= SPEED_SHARE * config.planned_speed / speed
        speed = acceleration * seconds / 2.0
    travel = speed * seconds / 2.0
    return StepPlan(torque, seconds, travel, speed, 3.0 * travel + hold.stays_off)


def step_phases(plan: StepPlan, hold: Hold, bursts: int, seed: int) -> list[Phase]:
    """Return the program: bursts of steps, each after a return to the centre.

    Args:
        plan: Plan from ``plan_steps``.
        hold: The spring of the returns.
        bursts: Number of bursts, >= 1.
        seed: Seed of the random lengths and amplitudes.
    """
    random = np.random.default_rng(seed)
    phases: list[Phase] = []
    for burst in range(bursts):
        phases.append(hold.phase(_RETURN_S, still_s=_REST_S))
        sign = 1.0 if burst % 2 == 0 else -1.0
        # The speeds at the steps are drawn, and the lengths follow: independent lengths would
        # accumulate a speed that no step reverses. The burst begins and ends at rest.
        speeds = [0.0, *random.uniform(1.0 - _SPREAD, 1.0, PER_BURST), 0.0]
        for before, after in pairwise(speeds):
            share = 1.0 - random.uniform(0.0, _AMPLITUDES)
            length = plan.seconds * (before + after) / 2.0 / share
            phases.append(Phase(length, torque=sign * plan.torque * share, reach=plan.reach))
            sign = -sign
    phases.append(hold.phase(_RETURN_S, still_s=_REST_S))
    return phases


@dataclass(frozen=True, slots=True)
class Mode:
    """The vibration of a load behind the transmission, as the encoder sees it.

    A torque u moves it by ``residue u / (M (s² + 2 ratio rate s + rate²))``, beside ``u / (M s²)``
    of the rigid body of the whole inertia M: exact without the motor's own friction.
    """

    rate: float
    """Angular frequency with both ends free [rad/s]"""
    ratio: float
    """Damping ratio, below 1"""
    residue: float
    """-1 at the output; load over motor inertia at the motor"""

    @classmethod
    def of(cls, config: Config) -> Mode | None:
        """Return the believed one; None: there is none, or it is too fast to be sampled."""
        belief = config.belief()
        if not belief.is_flexible or belief.is_fast(config.period_s):
            return None
        load = belief.load_inertia.value
        on_motor = load / max(belief.inertia.value - load, 0.05 * belief.inertia.value)
        return cls(
            math.tau * belief.flexible_hz.value,
            min(belief.flexible_damping_ratio.value, 0.9),
            -1.0 if belief.encoder == "output" else on_motor,
        )

    def free(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return both free vibrations at a time [s]."""
        rate = self.rate * math.sqrt(1.0 - self.ratio**2)
        fading = np.exp(-self.ratio * self.rate * time)
        return fading * np.cos(rate * time), fading * np.sin(rate * time)

    def forced(self, time: FloatArray) -> FloatArray:
        """Return the motion that a step of the torque at time 0 adds, per acceleration [s²]."""
        cos, sin = self.free(np.maximum(time, 0.0))
        skew = self.ratio / math.sqrt(1.0 - self.ratio**2)
        found: FloatArray = self.residue * (1.0 - cos - skew * sin) / self.rate**2
        return found


@dataclass(frozen=True, slots=True)
class Step:
    """One change of the torque, and the samples around it in which the shaft keeps its direction.

    Times count from the instant at which the changed torque was sent.
    """

    time: FloatArray
    """Sample instants [s]"""
    position: FloatArray
    """[rad]"""
    before: float
    """Torque sent before [N·m]"""
    after: float
    """Torque sent from then on [N·m]"""
    direction: float
    """1.0 or -1.0: sign of the velocity"""
    commanded: float
    """Time of the sample of the changed torque [s], <= 0"""
    age: float
    """From a sample to the sending of a torque in that same period [s]"""
    sent_s: float
    """When it was sent, on the run's clock [s]"""
    burst: int
    """Number of the burst it belongs to"""
    mode: Mode | None = None
    """Vibration of the servo, the same in all steps; None: it is rigid"""


def steps_of(
    rows: NDArray[np.void],
    phases: Sequence[Phase],
    period_ns: int,
    delay_steps: int,
    lag_s: float,
    mode: Mode | None = None,
) -> list[Step]:
    """Return the steps of a log with enough samples around them.

    Args:
        rows: Dtype ``telemetry.ROW``.
        phases: Phases of the program.
        period_ns: [ns].
        delay_steps: Periods inserted between command and sending.
        lag_s: Time from sending to action [s], within about a period.
        mode: Vibration of the servo; None: it is rigid.
    """
    rows = good(rows)
    changes = _changes(rows, phases, period_ns, delay_steps)
    sampled: IntArray = rows["sampled_ns"]
    age: IntArray = rows["age_ns"]
    sent = sampled + age
    lag_ns = round(lag_s * 1e9)
    steps: list[Step] = []
    for place in range(1, len(changes) - 1):
        (_, before, _), (row, now, burst), (_, after, _) = changes[place - 1 : place + 2]
        if not changes[place - 1][2] == burst == changes[place + 1][2]:
            continue
        if rows["torque"][now - 1] * rows["torque"][now] >= 0.0:
            continue  # a stall of the machine fell within it
        at = int(sent[now]) + lag_ns
        first = int(np.searchsorted(sampled, sent[before] + lag_ns))
        middle = int(np.searchsorted(sampled, at))
        last = int(np.searchsorted(sampled, sent[after] + lag_ns))
        direction = math.copysign(1.0, rows["torque"][now - 1])
        inside = _one_way(direction * rows["position"][first:last], middle - first)
        if inside is None:
            continue
        chosen = slice(first + inside[0], first + inside[1])
        steps.append(
            Step(
                time=(sampled[chosen] - sent[now]) * 1e-9,
                position=rows["position"][chosen],
                before=float(rows["torque"][now - 1]),
                after=float(rows["torque"][now]),
                direction=direction,
                commanded=float(sampled[row] - sent[now]) * 1e-9,
                age=float(rows["age_ns"][now]) * 1e-9,
                sent_s=float(sent[now] - sent[0]) * 1e-9,
                burst=burst,
                mode=mode,
            )
        )
    return steps


def good(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Return the rows with a sample of their own; a lost one would repeat the last position."""
    kept: NDArray[np.void] = rows[rows["outcome"] == Outcome.OK]
    return kept


def rough_lag(rows: NDArray[np.void], period: float, longest: float) -> float:
    """Return the lag with the best correlation of torque and acceleration [s], to a period.

    Args:
        rows: Dtype ``telemetry.ROW``.
        period: [s].
        longest: Longest tried lag [s].
    """
    rows = good(rows)
    time: FloatArray = (rows["sampled_ns"] - rows["sampled_ns"][0]) * 1e-9
    age: FloatArray = rows["age_ns"] * 1e-9
    shown: FloatArray = rows["position"]
    sent: FloatArray = rows["torque"]
    even = np.arange(0.0, time[-1], period)
    position = np.interp(even, time, shown)
    torque = np.interp(even, time + age, sent)
    over = SHORTEST // 4  # periods of a velocity difference
    velocity = position[over:] - position[:-over]
    acceleration = velocity[over:] - velocity[:-over]
    # The same double mean of the torque, so that both are smoothed alike.
    mean = np.convolve(torque, np.convolve(np.ones(over), np.ones(over)) / over**2)
    mean = mean[2 * over - 1 :]  # ends with the sample that the acceleration ends with
    tried = range(int(longest / period) + 1)
    size = acceleration.size
    scores = [float(np.dot(acceleration[lag:], mean[: size - lag])) for lag in tried]
    return int(np.argmax(scores)) * period


def _changes(
    rows: NDArray[np.void], phases: Sequence[Phase], period_ns: int, delay_steps: int
) -> list[tuple[int, int, int]]:
    """Return the commanding row, the sending row, and the burst of each step's torque."""
    number = rows["phase"]
    starts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist()]
    deadline = rows["deadline_ns"]
    found: list[tuple[int, int, int]] = []
    burst = 0
    for row in starts:
        phase = phases[int(number[row])]
        if phase.stiffness:
            burst += 1
            continue
        # The ring counts periods, so the torque is sent with the first row at or after that time.
        sends = int(np.searchsorted(deadline, deadline[row] + delay_steps * period_ns))
        if sends < len(rows):
            found.append((row, sends, burst))
    return found


def _one_way(ahead: FloatArray, middle: int) -> tuple[int, int] | None:
    """Return the samples of one direction, between two reversals."""
    if middle < _FEWEST or ahead.size - middle < _FEWEST:
        return None
    begins = middle - 1 - int(np.argmin(ahead[:middle][::-1]))  # the last of the lowest
    ends = middle + int(np.argmax(ahead[middle:]))  # the first of the highest
    begins += 1 + round(_INSIDE * (middle - begins))
    ends -= round(_INSIDE * (ends - middle))
    if middle - begins < _FEWEST or ends - middle < _FEWEST:
        return None
    return begins, ends
