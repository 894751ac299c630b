"""Walls on a six-joint arm with gravity, simulated by MuJoCo: an independent truth.

It is skipped without it: ``pip install 'haptic-wall[arm]'``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import SIGNS, Side, Wall
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.servos import SERVOS
from tests.support.truth import COUNT

mujoco: Any = pytest.importorskip("mujoco", reason="pip install 'haptic-wall[arm]'")

SERVO, LIMIT, PERIOD, STEPS = SERVOS["MX-64"], 4.1, 1e-3, 4
DELAY = 0.001
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "1 0 0")
POSE = np.array([0.2, 0.7, 1.2, 0.3, 0.5, 0.0])
"""Bent, so that gravity loads the joints with up to 0.4 N·m [rad]"""


def arm() -> tuple[Any, Any]:
    """Return model and data of an arm of six links of 0.06 m and 0.08 kg, in the pose."""
    joint = (
        f'<joint type="hinge" axis="{{}}" armature="{SERVO.inertia}" damping="{SERVO.damping}"'
        f' frictionloss="{SERVO.coulomb}"/>'
        '<geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.06" mass="0.08" contype="0"/>'
    )
    links = "".join(f'<body pos="0 0 0.06">{joint.format(axis)}' for axis in AXES)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{PERIOD / STEPS}" integrator="implicitfast"/>'
        f"<worldbody>{links}{'</body>' * len(AXES)}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    return model, data


def gains(side: Side) -> tuple[float, float]:
    """Return what the guard commands for the bare servo."""
    exactly = Bounded.exactly
    friction, lag = exactly(SERVO.damping), exactly(DELAY)
    belief = Belief(exactly(SERVO.inertia), friction, exactly(0.0), lag, exactly(1.0))
    at = Situation(belief, PERIOD, LIMIT, COUNT)
    found = decide(Request(1e9, 0.06, side), GuardSettings(), at, [0.0])[0]
    return found.stiffness, found.damping


def run(
    side: Side, delay: float, seconds: float, answer: Any = "reduce", start: float = 0.0
) -> tuple[FloatArray, list[Watch]]:
    """Return the joints' angles from the walls, ticks × axes, and the watches.

    Args:
        side: Of the walls, which are at the pose.
        delay: True delay [s].
        seconds: Duration.
        answer: To an alarm.
        start: Of all joints, from the pose [rad].
    """
    model, data = arm()
    data.qpos[:] += start
    (stiffness, damping), shared = gains(side), Shared()
    settings = WatchSettings(
        PERIOD,
        COUNT,
        answer,
        SIGNS[side],
        light=SERVO.inertia,
        torque_limit=LIMIT,
        rest_torque=0.1,
    )
    laws = [Wall(stiffness, damping, float(at), side) for at in POSE]
    watches = [Watch(settings, shared) for _ in laws]
    for law, watch in zip(laws, watches, strict=True):
        law.derating = watch.backstop.wall.derating
    late, ticks = round(delay / PERIOD * STEPS), round(seconds / PERIOD)
    sent = np.zeros((ticks * STEPS + late + STEPS, len(laws)))
    angles, last = np.zeros((ticks, len(laws))), np.round(data.qpos / COUNT) * COUNT
    for tick in range(ticks):
        angles[tick] = data.qpos - POSE
        places = np.round(data.qpos / COUNT) * COUNT
        for i, (law, watch) in enumerate(zip(laws, watches, strict=True)):
            watch.sample(float(places[i]), law, math.nan, 1)
            torque = law.torque(float(places[i]), float(places[i] - last[i]) / PERIOD)
            sent[tick * STEPS + late :, i] = torque = max(-LIMIT, min(LIMIT, torque))
            watch.sent(torque)
        last = places
        for step in range(tick * STEPS, (tick + 1) * STEPS):
            data.qfrc_applied[:] = sent[step]
            mujoco.mj_step(model, data)
    return angles, watches


@pytest.mark.parametrize("side", ["both", "above", "below"])
def test_walls_at_six_joints_let_the_arm_come_to_rest(side: Side) -> None:
    angles, watches = run(side, DELAY, 2.0, start=0.05)
    if side == "both":
        assert np.ptp(angles[-500:], axis=0).max() < 2.0 * COUNT
    assert np.abs(angles).max() < 0.2 or side != "both"
    assert all(math.isnan(watch.first_alarm_s) for watch in watches)
    assert all(watch.backstop.wall.reduced == (1.0, 1.0) for watch in watches)


def test_a_lag_of_four_times_the_belief_is_found_and_the_arm_is_held() -> None:
    told, _ = run("both", 0.004, 2.5, "report", 0.05)
    assert np.ptp(told[-500:], axis=0).max() > 0.1, "it oscillates"
    angles, watches = run("both", 0.004, 3.0, start=0.05)
    assert not any(watch.failed for watch in watches)
    assert np.ptp(angles[-1000:], axis=0).max() < 0.03
    assert 0.0 < watches[0].backstop.wall.reduced[0] < 1.0
    assert np.abs(angles[-1]).max() < 0.1, "the load stays"
