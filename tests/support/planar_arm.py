"""A planar two-link arm with virtual walls at its joints, and a hand at the tip.

It is independent of the package's plant: closed-form dynamics, Runge-Kutta of fourth order in steps
of a quarter of a millisecond. Point masses are at the ends of the links, and a servo's inertia at
each joint; Coulomb friction grows over 0.02 rad/s. It moves in a horizontal plane: no gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch, oscillation_report
from haptic_wall.controller.laws.wall import SIGNS, Side, Wall
from haptic_wall.controller.theory.checks import FloatArray
from tests.support.operators import NOBODY, Operator
from tests.support.trial import Trial
from tests.support.truth import Truth
from tests.support.truths_drawn import bench_of

PERIOD = 1e-3
_STEPS = 4
_SOFT = 0.02
"""Speed over which Coulomb friction grows [rad/s]"""
_ENGAGE = 0.05
"""Share of the stall torque at which gains return [1]"""


@dataclass(frozen=True, slots=True)
class ArmCase:
    """All parameters of a trial: its printed text can be run again."""

    preset: str
    truths: tuple[Truth, Truth]
    """Of the servos"""
    lengths: tuple[float, float]
    """Of the links [m]"""
    masses: tuple[float, float]
    """At their ends [kg]"""
    stiffness: tuple[float, float]
    """K of the walls [N·m/rad]; 0: no wall"""
    damping: tuple[float, float]
    """B of the walls [N·m·s/rad]"""
    sides: tuple[Side, Side] = ("both", "both")
    pose: tuple[float, float] = (0.0, 1.0)
    """Positions of the walls: they act about this pose [rad]"""
    start: tuple[float, float] = (0.1, 0.1)
    """From the pose [rad]"""
    loads: tuple[float, float] = (0.0, 0.0)
    """Constant torques on the joints [N·m]"""
    duration_s: float = 8.0

    def inertia(self) -> np.ndarray:
        """Return M in the pose [kg·m²]."""
        a, b, c = self._parts()
        bent = c * math.cos(self.pose[1])
        links = [[a + b + 2.0 * bent, b + bent], [b + bent, b]]
        return np.array(links) + np.diag([one.inertia for one in self.truths])

    def _parts(self) -> tuple[float, float, float]:
        (l1, l2), (m1, m2) = self.lengths, self.masses
        return (m1 + m2) * l1 * l1, m2 * l2 * l2, m2 * l1 * l2


@dataclass(slots=True)
class Arm:
    """The moving arm."""

    case: ArmCase
    state: list[float] = field(default_factory=list)
    """Joint angles [rad], speeds [rad/s]"""

    def __post_init__(self) -> None:
        case = self.case
        self.state = [p + s for p, s in zip(case.pose, case.start, strict=True)] + [0.0, 0.0]

    def acceleration(
        self, q1: float, q2: float, v1: float, v2: float, pull: tuple[float, ...]
    ) -> tuple[float, float]:
        """Return the joints' accelerations [rad/s²].

        Args:
            q1, q2: Angles [rad].
            v1, v2: Speeds [rad/s].
            pull: Torques of the servos [N·m], then what holds the tip: stiffness [N/m], damping
                [N·s/m], the place [m, m].
        """
        case = self.case
        first, second = case.truths
        a, b, c = case._parts()
        bent, crooked = c * math.cos(q2), c * math.sin(q2)
        m11, m12 = first.inertia + a + b + 2.0 * bent, b + bent
        m22 = second.inertia + b
        t1, t2, spring, damper, x, y = pull
        t1, t2 = t1 + case.loads[0], t2 + case.loads[1]
        t1 += crooked * v2 * (2.0 * v1 + v2) - first.damping * v1
        t2 -= crooked * v1 * v1 + second.damping * v2
        t1 -= first.coulomb * max(-1.0, min(1.0, v1 / _SOFT))
        t2 -= second.coulomb * max(-1.0, min(1.0, v2 / _SOFT))
        if spring or damper:
            l1, l2 = case.lengths
            s1, s12 = l1 * math.sin(q1), l2 * math.sin(q1 + q2)
            c1, c12 = l1 * math.cos(q1), l2 * math.cos(q1 + q2)
            fx = spring * (x - c1 - c12) + damper * ((s1 + s12) * v1 + s12 * v2)
            fy = spring * (y - s1 - s12) - damper * ((c1 + c12) * v1 + c12 * v2)
            t1 += (c1 + c12) * fy - (s1 + s12) * fx
            t2 += c12 * fy - s12 * fx
        det = m11 * m22 - m12 * m12
        return (m22 * t1 - m12 * t2) / det, (m11 * t2 - m12 * t1) / det

    def step(self, pull: tuple[float, ...], h: float) -> None:
        """Move on by ``h`` [s]; ``pull`` as of ``acceleration``."""
        q1, q2, v1, v2 = self.state
        a1, a2 = self.acceleration(q1, q2, v1, v2, pull)
        k = 0.5 * h
        u1, u2 = v1 + k * a1, v2 + k * a2
        b1, b2 = self.acceleration(q1 + k * v1, q2 + k * v2, u1, u2, pull)
        w1, w2 = v1 + k * b1, v2 + k * b2
        c1, c2 = self.acceleration(q1 + k * u1, q2 + k * u2, w1, w2, pull)
        x1, x2 = v1 + h * c1, v2 + h * c2
        d1, d2 = self.acceleration(q1 + h * w1, q2 + h * w2, x1, x2, pull)
        r = h / 6.0
        self.state = [
            q1 + r * (v1 + 2.0 * (u1 + w1) + x1),
            q2 + r * (v2 + 2.0 * (u2 + w2) + x2),
            v1 + r * (a1 + 2.0 * (b1 + c1) + d1),
            v2 + r * (a2 + 2.0 * (b2 + c2) + d2),
        ]


def energy(case: ArmCase, trials: tuple[Trial, Trial]) -> FloatArray:
    """Return the energy of the arm and of the walls' springs as they are at each tick [J].

    Args:
        case: The arm, with a wall at each joint.
        trials: Its records.
    """
    (q1, q2), (one, two) = [trial.output for trial in trials], case.truths
    v1, v2 = (np.gradient(trial.output, trial.period) for trial in trials)
    a, b, c = case._parts()
    bent = c * np.cos(q2)
    m11, m12, m22 = one.inertia + a + b + 2.0 * bent, b + bent, two.inertia + b
    found: FloatArray = 0.5 * (m11 * v1 * v1 + m22 * v2 * v2) + m12 * v1 * v2
    for q, trial, truth, k, at in zip(
        (q1, q2), trials, case.truths, case.stiffness, case.pose, strict=True
    ):
        far = np.abs(q - at)
        straight = np.minimum(far, truth.torque_limit / k)
        spring = k * straight * (far - 0.5 * straight)
        found += truth.torque_gain * trial.stiffness / k * spring
    return found


def run_arm(
    case: ArmCase, answer: str = "reduce", operator: Operator = NOBODY, angle: float = 0.0
) -> tuple[Trial, Trial]:
    """Run the walls, each with its watch, which share a probe; return the record of each axis.

    Args:
        case: The arm.
        answer: To an alarm.
        operator: Moves the tip to and fro along a line, by its angles times the arm's length.
        angle: Of that line [rad].
    """
    bench = bench_of(case.preset)
    belief, shared, axes = bench.belief, Shared(), []
    for k, b, side, at, truth in zip(
        case.stiffness, case.damping, case.sides, case.pose, case.truths, strict=True
    ):
        settings = WatchSettings(
            PERIOD,
            truth.position_step,
            answer,  # type: ignore[arg-type]
            SIGNS[side],
            light=belief.inertia.low / belief.torque_gain.high,
            lag=belief.delay.value,
            torque_limit=truth.torque_limit,
            rest_torque=min(0.1, _ENGAGE * bench.stall_torque),
        )
        law = Wall(k, b, at, side)
        watch = Watch(settings, shared)
        law.derating = watch.backstop.wall.derating
        axes.append((law, watch, truth, round(truth.delay / PERIOD * _STEPS)))
    arm = Arm(case)
    reach = sum(case.lengths)
    l1, l2 = case.lengths
    turned = case.pose[0] + case.pose[1]
    tip = (
        l1 * math.cos(case.pose[0]) + l2 * math.cos(turned),
        l1 * math.sin(case.pose[0]) + l2 * math.sin(turned),
    )
    along = math.cos(angle) * reach, math.sin(angle) * reach
    ticks = round(case.duration_s / PERIOD)
    rows = np.full((2, 6, ticks), np.nan)
    last: list[float | None] = [None, None]
    due: list[dict[int, float]] = [{}, {}]
    acts, trip = [0.0, 0.0], None
    for tick in range(ticks):
        for i, (law, watch, truth, late) in enumerate(axes):
            output, count = arm.state[i], truth.position_step
            position = round(output / count) * count if count else output
            before = last[i]
            velocity = 0.0 if before is None else (position - before) / PERIOD
            last[i] = position
            watch.sample(position, law, math.nan, 1)
            torque = law.torque(position, velocity)
            limit = truth.torque_limit
            sent = max(-limit, min(limit, torque))
            watch.sent(sent)
            due[i][tick * _STEPS + late] = sent * truth.torque_gain
            scale = law.derating
            rows[i, :, tick] = (
                output,
                position,
                sent,
                law.stiffness * scale.scale,
                law.damping * scale.damping_scale,
                watch.current,
            )
        if any(watch.failed for _, watch, _, _ in axes):
            trip, ticks = "oscillation", tick + 1
            break
        k, d, wanted, speed, _ = operator.rows[tick] if tick < len(operator.rows) else (0.0,) * 5
        wanted += speed * d / k if k else 0.0  # its damper moves with it
        grip = k / reach**2, d / reach**2, tip[0] + wanted * along[0], tip[1] + wanted * along[1]
        for step in range(tick * _STEPS, (tick + 1) * _STEPS):
            for i in (0, 1):
                acts[i] = due[i].pop(step, acts[i])
            arm.step((*acts, *grip), PERIOD / _STEPS)
    trials = []
    for row, (_, watch, truth, _) in zip(rows[:, :, :ticks], axes, strict=True):
        back = watch.backstop
        trials.append(
            Trial(
                period=PERIOD,
                output=row[0],
                measured=row[1],
                torque=row[2],
                stiffness=row[3],
                damping=row[4],
                held=np.zeros(ticks),
                state=row[5].astype(np.int64),
                saturated=np.abs(row[2]) >= truth.torque_limit,
                first_alarm_s=watch.first_alarm_s,
                trip=trip,
                oscillation=oscillation_report(watch),
                counts=(back.probes, back.hands, back.alarms),
            )
        )
    return trials[0], trials[1]
