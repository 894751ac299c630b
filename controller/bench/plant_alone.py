"""Measures how fast servos are simulated without a wall, beside mujoco.rollout and scipy.signal.

These peers take every torque before the first step, whereas a wall's torque depends on the motion.
So they can compute only the linear servo without a wall. The program runs its whole loop here
too, with a wall of zero stiffness; the given torques are those of an operator.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Final

import numpy as np

from haptic_wall.controller.bench.rows import Measurement, interleaved, over_rounds, ratio
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import HandName, TrueServo

PERIOD_S: Final = 1e-3
LINEAR: Final = TrueServo(inertia=0.012, damping=0.012, counts_per_rev=0, torque_limit=math.inf)
_ROUNDS, _PERIODS = 5, 1000
_MANY, _SOME, _FEW = 512, 128, 8
_TORQUE: Final = 0.1
_PERIOD_NS: Final = 1_000_000
_SWING: Final = 0.5
"""Amplitude of the torque that moves one servo to and fro [N·m]"""
_IDEAL: Final = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)
_REAL: Final = replace(
    _IDEAL,
    static_friction=0.14,
    stribeck_speed=1.1,
    damping_back=0.02,
    load_friction=0.1,
    gravity=0.2,
    cogging=0.02,
    encoder_eccentricity=0.002,
    encoder_noise=0.3,
)
_NOT_THE_TICK: Final = "a tick of the loop, which does more"
_SAME: Final = 1e-9
"""Difference of positions up to which two answers agree [rad]"""
_NOT_CLOSED = "the wall's closed loop, friction and encoder: only the linear servo is equal"
_NOTES: Final = (
    "figures are per second of processor time, which depends little on other work of the machine;"
    " only the rows of one core and of two cores are per second on the clock",
    "not compared with mujoco.rollout and scipy.signal: the wall's delayed torque in closed loop,"
    " which they do not support (mujoco.rollout and filters need all torques beforehand), Coulomb"
    " friction, which MuJoCo models as a soft constraint, the encoder, and more than one thread",
)


@dataclass(frozen=True, slots=True)
class Client:
    """A simulator of servos, as measured here."""

    positions: Callable[[FloatArray], FloatArray]
    """Computes the positions [rad] at the ends of the periods from torques [N·m], both (servo,
    period)"""
    servos: int
    exact: bool = True
    """Whether its answer is exact for torques that are held over each period"""


def beside_peers() -> tuple[list[Measurement], list[str]]:
    """Measure all simulators; return rates, differences of their answers, and notes."""
    notes = list(_NOTES)
    peers = {**_scipy(), **_mujoco(notes)}
    name, many = "haptic-wall, compiled", _MANY
    if compiled() is None:
        name, many = "haptic-wall", _FEW
    ours = {name: Client(_pushed, many)}
    clients = {**ours, **peers}
    torques = np.random.default_rng(1).uniform(-_TORQUE, _TORQUE, (_MANY, _PERIODS))
    work = {
        name: partial(client.positions, torques[: client.servos])
        for name, client in clients.items()
    }
    times = interleaved(work, _ROUNDS, time.process_time)
    each = {
        name: [one / (client.servos * _PERIODS) for one in times[name]]
        for name, client in clients.items()
    }
    expected = _pushed(torques[:_SOME])
    rows = one_tick()
    for name, client in clients.items():
        what = f"{name}, servo alone, {client.servos} at once"
        rows.append(
            over_rounds(what, [1 / one for one in each[name]], "servo-periods/s", _NOT_CLOSED)
        )
    for name, client in peers.items():
        some = min(client.servos, _SOME)
        apart = float(np.max(np.abs(client.positions(torques[:some]) - expected[:some])))
        rows += [
            ratio(
                f"{own} over {name}, servo alone",
                each[name],
                each[own],
                "few servos, and other abilities of that library",
            )
            for own in ours
        ]
        rows.append(
            Measurement(
                f"largest difference of position from {name}",
                apart,
                "rad",
                "other torques than these, over one second",
            )
        )
        if client.exact and apart > _SAME:
            notes.append(
                f"{name}: the answers differ by up to {apart:.2g} rad, so the ratio compares"
                " different results"
            )
    return rows, notes


def one_tick() -> list[Measurement]:
    """Measure the time of one servo's simulation for a period, ideal and with every effect."""

    def run(servo: TrueServo) -> None:
        mechanism = Mechanism(servo, 0)
        for k in range(_PERIODS):
            mechanism.command(_SWING * math.sin(0.02 * k), k * _PERIOD_NS)
            mechanism.advance((k + 1) * _PERIOD_NS)
            mechanism.measured()

    hands: dict[str, HandName] = {"alone": "none", "with an operator": "push"}
    work = {
        f"a period of one servo, {effects}, {hand}": partial(run, replace(servo, hand=name))
        for effects, servo in (("ideal", _IDEAL), ("with every effect", _REAL))
        for hand, name in hands.items()
    }
    return [
        over_rounds(name, [1e6 * one / _PERIODS for one in times], "µs", _NOT_THE_TICK)
        for name, times in interleaved(work, _ROUNDS, time.process_time).items()
    ]


def _pushed(torques: FloatArray) -> FloatArray:
    wall = wall_of(LINEAR, period=PERIOD_S, delay=0.0, virtual_damping=0.0)
    return np.array([Loop(wall, 0.0, 0.0).run(row.size, row)[:, 0] for row in torques])


def _scipy() -> dict[str, Client]:
    signal = importlib.import_module("scipy.signal")
    inertia, damping = LINEAR.inertia, LINEAR.damping
    matrices = (
        np.array([[0.0, 1.0], [0.0, -damping / inertia]]),
        np.array([[0.0], [1.0 / inertia]]),
        np.array([[1.0, 0.0]]),
        np.array([[0.0]]),
    )
    numerator, denominator, _ = signal.cont2discrete(
        ([1.0], [inertia, damping, 0.0]), PERIOD_S, method="zoh"
    )
    held = signal.cont2discrete(matrices, PERIOD_S, method="zoh")

    def filtered(torques: FloatArray) -> FloatArray:
        after = np.concatenate([torques, np.zeros((len(torques), 1))], axis=1)
        found: FloatArray = signal.lfilter(numerator.ravel(), denominator, after, axis=1)[:, 1:]
        return found

    def one_by_one(torques: FloatArray) -> FloatArray:
        after = np.concatenate([torques, np.zeros((len(torques), 1))], axis=1)
        return np.array([signal.dlsim(held, given)[1][1:, 0] for given in after])

    name = f"scipy {version('scipy')}"
    return {
        f"{name} signal.lfilter": Client(filtered, _MANY),
        f"{name} signal.dlsim": Client(one_by_one, _FEW),
    }


def _mujoco(notes: list[str]) -> dict[str, Client]:
    """Return a client for each of two integrators: the usual one, and an accurate one."""
    try:
        mujoco = importlib.import_module("mujoco")
        rollout = importlib.import_module("mujoco.rollout").rollout
    except ImportError as error:
        notes.append(
            f"mujoco cannot be used ({error}), so nothing is compared with it: pip install"
            " -e '.[bench]' in the clone adds it where it has a build"
        )
        return {}

    def client(integrator: str) -> Callable[[FloatArray], FloatArray]:
        model = mujoco.MjModel.from_xml_string(
            _MODEL.format(
                integrator=integrator,
                period=PERIOD_S,
                inertia=LINEAR.inertia,
                damping=LINEAR.damping,
            )
        )
        data = mujoco.MjData(model)
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)

        def positions(torques: FloatArray) -> FloatArray:
            states, _ = rollout(model, data, np.zeros((len(torques), size)), torques[:, :, None])
            found: FloatArray = states[:, :, 1]  # time, position, velocity
            return found

        return positions

    name = f"mujoco {mujoco.__version__} rollout"
    return {
        f"{name}, Euler": Client(client("Euler"), _SOME, exact=False),
        f"{name}, RK4": Client(client("RK4"), _SOME // 4),
    }


_MODEL: Final = """
<mujoco>
  <option timestep="{period}" gravity="0 0 0" integrator="{integrator}">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body>
      <joint name="shaft" type="hinge" axis="0 0 1" damping="{damping}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>
    </body>
  </worldbody>
  <actuator><motor joint="shaft"/></actuator>
</mujoco>
"""
