"""How many periods of how many walls are simulated in a second, beside one alone and peers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from controller.benchmarks.plant_alone import LINEAR, PERIOD_S, alike, beside_peers
from controller.benchmarks.rows import Row, Section, interleaved, over_rounds, ratio
from controller.experiments.many_walls import BLOCK, Loops
from controller.theory.checks import FloatArray
from hw.clock import SimulatedClock
from hw.open import open_servo
from hw.settings import SimulatedSettings, TrueServo

_ROUNDS = 5
_PERIODS, _PERIODS_ALONE = 1000, 5000
_PERIOD_NS = round(1e9 * PERIOD_S)
_STIFFNESS, _VIRTUAL_DAMPING, _KICK = 10.0, 0.05, 0.05
_ROUGH = TrueServo(
    inertia=0.012, damping=0.012, coulomb=0.02, counts_per_rev=4096, torque_limit=4.1
)


def measure() -> Section:
    """Two-sided walls as an array and one alone; the servo without its wall beside peers."""
    work: dict[str, Callable[[], object]] = {
        "linear": lambda: _array(LINEAR),
        "rough": lambda: _array(_ROUGH),
        "linear alone": lambda: alone(LINEAR, _PERIODS_ALONE),
        "rough alone": lambda: alone(_ROUGH, _PERIODS_ALONE),
    }
    times = interleaved(work, _ROUNDS)
    rows = []
    for name, servo in (("linear", LINEAR), ("rough", _ROUGH)):
        what = "linear servo" if name == "linear" else "friction and encoder"
        many = [one / (BLOCK * _PERIODS) for one in times[name]]
        single = [one / _PERIODS_ALONE for one in times[f"{name} alone"]]
        apart = float(np.max(np.abs(together(servo, 1, _PERIODS)[0] - alone(servo, _PERIODS))))
        rows += [
            over_rounds(
                f"array of {BLOCK}, {what}",
                [1 / one for one in many],
                "wall-periods/s",
                "walls with backlash or long velocity differences, and the search around it",
            ),
            over_rounds(
                f"one alone, {what}",
                [1 / one for one in single],
                "wall-periods/s",
                "the program's own loop, which also guards, watches and logs",
            ),
            ratio(f"ratio, {what}", single, many, "few walls: an array pays from some ten on"),
            Row(
                f"difference of position from one alone, {what}",
                apart,
                "rad",
                "other settings than these, over one second",
            ),
        ]
    compared, notes = beside_peers()
    return Section((*rows, *compared), tuple(notes))


def _array(servo: TrueServo) -> object:
    return together(servo, BLOCK, _PERIODS)


def together(servo: TrueServo, count: int, periods: int) -> FloatArray:
    """Last measured positions [rad] of that many walls, all alike, after some periods."""
    walls = alike(servo, count, _STIFFNESS, _VIRTUAL_DAMPING)
    loops = Loops(walls, np.full(count, _KICK))
    loops.run(periods)
    return loops.measured


def alone(servo: TrueServo, periods: int) -> float:
    """Last measured position [rad] of the simulated servo with that wall, run by itself."""
    clock = SimulatedClock()
    true = TrueServo(
        servo.inertia,
        servo.damping,
        servo.coulomb,
        servo.counts_per_rev,
        torque_limit=servo.torque_limit,
        position=_KICK,
    )
    body = open_servo(SimulatedSettings(true), clock)
    body.start()
    before = math.nan
    for k in range(periods):
        body.request()
        position = body.collect(clock.now_ns()).position
        velocity = (position - before) / PERIOD_S if k else 0.0
        body.write(-_STIFFNESS * position - _VIRTUAL_DAMPING * velocity)
        before = position
        clock.wait_until((k + 1) * _PERIOD_NS)
    body.close()
    return before
