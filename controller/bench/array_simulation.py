"""Measures how many wall periods are simulated a second: arrays, compiled, one by one, by peers."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from haptic_wall.controller.bench import two_cores
from haptic_wall.controller.bench.plant_alone import PERIOD_S, beside_peers
from haptic_wall.controller.bench.rows import Measurement, Section, interleaved, over_rounds, ratio
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.tables import Table
from haptic_wall.controller.experiments.maps.walls import BLOCK, Walls
from haptic_wall.controller.laws.detents import Detents
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.settings import ServoSettings, TrueServo

SIZE = 128
"""Numbers that are worked on together, in registers or the first-level cache"""
_TIMES = 100_000
OPERATIONS = SIZE * _TIMES
"""Operations of one call"""


def multiply_adds(x: FloatArray, times: int) -> float:
    """Multiply and add to each number of ``x``, shape (SIZE,), ``times`` times."""
    for _ in range(times):
        for i in range(SIZE):
            x[i] = x[i] * 0.999 + 0.001
    return float(x[0])


def divisions(x: FloatArray, times: int) -> float:
    """Divide each number of ``x``, shape (SIZE,), ``times`` times."""
    for _ in range(times):
        for i in range(SIZE):
            x[i] = 1.5 / x[i]  # to and fro between two numbers
    return float(x[0])


def arithmetic(times: int = 1) -> dict[str, Callable[[], object]]:
    """Return the measured functions by name, each of ``OPERATIONS``; none without Numba.

    Each call of this function gives them numbers of their own, and they hold no lock of the
    interpreter, so that two threads can run them side by side.

    Args:
        times: How often each does its ``OPERATIONS`` in one call.
    """
    made: dict[str, Callable[[], object]] = {}
    for name, part in _compiled().items():
        # The middle of a larger array: no other thread writes to its cache lines.
        numbers = np.full(3 * SIZE, 1.2)[SIZE : 2 * SIZE]
        made[name] = partial(part, numbers, times * _TIMES)
    return made


@lru_cache(maxsize=1)
def _compiled() -> dict[str, Callable[[FloatArray, int], float]]:
    try:
        numba: Any = importlib.import_module("numba")
    except ImportError:
        return {}
    compiled = numba.njit(fastmath={"contract"}, error_model="numpy", nogil=True)
    return {part.__name__.replace("_", "-"): compiled(part) for part in (multiply_adds, divisions)}


_ROUNDS = 5
_PERIODS, _PERIODS_ALONE = 1000, 5000
_PERIOD_NS = round(1e9 * PERIOD_S)
_ARITHMETIC_TIMES = 100
"""Factor of the arithmetic's operations that two cores share: a call takes some 50 ms"""
_COMPARED = 8
"""Number of walls of an array that are also simulated alone"""
_NOT_THE_SEARCH = "walls with backlash or long velocity differences, and the search around it"
_BUSY = "a machine with more cores, or with busy cores: this is the time on the clock"
_ROUGH = "servos with friction and encoder"
_OPERATIONS = {"linear servos": (18, 3), _ROUGH: (36, 4)}
"""Multiply-adds, or what takes as long, and divisions of a wall period in ``lanes``, where no body
comes to rest: a period has two parts"""
_KINDS = {"linear servos": False, _ROUGH: True}
_DETENTS = "detents"
_WIDTH = math.tau / 24
"""Distance between detents [rad]"""


def _compiled_rows(
    what: str, walls: list[ArrayWall], times: Mapping[str, Sequence[float]]
) -> list[Measurement]:
    """Return rates of the compiled loop, beside the arrays and the machine's arithmetic."""
    each = len(walls) * _PERIODS
    one = times[f"{what}, compiled"]
    adds, parts = _OPERATIONS[what]
    least = [
        (adds * add + parts * part) / OPERATIONS * each
        for add, part in zip(times["multiply-adds"], times["divisions"], strict=True)
    ]
    in_arrays, in_lanes = (together(walls, _PERIODS, compile_=way) for way in (False, True))
    name, unit = f"{len(walls)} random walls, {what}", "wall-periods/s"
    return [
        over_rounds(f"compiled, {name}", [each / s for s in one], unit, _NOT_THE_SEARCH),
        ratio(f"compiled over the array, {what}", times[what], one, _NOT_THE_SEARCH),
        over_rounds(
            f"the arithmetic alone: {adds} multiply-adds and {parts} divisions for each, {what}",
            [each / s for s in least],
            unit,
            "a practical loop: this one loads, stores and stops nothing",
        ),
        ratio(
            f"compiled over the arithmetic alone, {what}",
            least,
            one,
            "a practical loop: this one loads, stores and stops nothing",
        ),
        Measurement(
            f"largest difference of position from the array, {what}",
            float(np.max(np.abs(in_lanes - in_arrays))),
            "rad",
            "other walls than these, over one second",
        ),
    ]


def _two_core_rows(drawn: Mapping[str, list[ArrayWall]]) -> list[Measurement]:
    """Return what a second core adds to the compiled loop, and to the machine's arithmetic."""
    works: dict[str, two_cores.Made] = {
        what: two_cores.simulation(*_as_arrays(walls)[:2], _PERIODS)
        for what, walls in drawn.items()
    }
    for name in arithmetic():
        parts = tuple(arithmetic(_ARITHMETIC_TIMES)[name] for _ in range(2))
        works[name] = partial(_same, (parts[0], parts[1]))
    rows = []
    for what, (in_turn, at_once) in two_cores.in_turn_and_at_once(works).items():
        if what not in drawn:
            rows.append(ratio(f"{what} alone, two cores over one", in_turn, at_once, _BUSY))
            continue
        walls = len(drawn[what])
        each, unit = walls * _PERIODS * two_cores.RUNS, "wall-periods/s"
        for cores, times in (("one core", in_turn), ("two cores", at_once)):
            name = f"compiled on {cores}, {walls} random walls, {what}"
            rows.append(over_rounds(name, [each / s for s in times], unit, _BUSY))
        rows.append(ratio(f"compiled, two cores over one, {what}", in_turn, at_once, _BUSY))
    return rows


def _same(parts: tuple[two_cores.Work, two_cores.Work]) -> tuple[two_cores.Work, two_cores.Work]:
    return parts


@dataclass(frozen=True, slots=True)
class ArrayWall:
    """A two-sided wall on a servo of its own, released at ``servo.position``."""

    servo: TrueServo
    stiffness: float
    """K [N·m/rad]"""
    virtual_damping: float
    """B [N·m·s/rad]"""


def measure() -> Section:
    """Measure two-sided walls as an array and one alone, and the servo alone beside peers."""
    drawn = {what: random_walls(rough, BLOCK) for what, rough in _KINDS.items()}
    work: dict[str, Callable[[], object]] = dict(arithmetic())
    fast = compiled() is not None
    for what, walls in drawn.items():
        arrays = _as_arrays(walls)[:2]
        work[what] = partial(_run, *arrays, _PERIODS, compile_=False)
        work[f"{what}, alone"] = partial(_each_alone, walls)
        if fast:
            work[f"{what}, compiled"] = partial(_run, *arrays, _PERIODS)
    if fast:
        work[_DETENTS] = _in_detents(drawn[_ROUGH])
    times = interleaved(work, _ROUNDS, time.process_time)
    rows = []
    for what, walls in drawn.items():
        if fast:
            rows += _compiled_rows(what, walls, times)
        many = [one / (len(walls) * _PERIODS) for one in times[what]]
        single = [one / _PERIODS_ALONE for one in times[f"{what}, alone"]]
        few = walls[:_COMPARED]
        apart = together(few, _PERIODS) - [alone(wall, _PERIODS) for wall in few]
        rows += [
            over_rounds(
                f"array of {len(walls)} random walls, {what}",
                [1 / one for one in many],
                "wall-periods/s",
                _NOT_THE_SEARCH,
            ),
            over_rounds(
                f"{len(few)} of them, one by one",
                [1 / one for one in single],
                "wall-periods/s",
                "the program's own loop, which also guards, watches and logs",
            ),
            ratio(f"ratio, {what}", single, many, "few walls: an array is faster from some ten on"),
            Measurement(
                f"largest difference of position from them alone, {what}",
                float(np.max(np.abs(apart))),
                "rad",
                "other walls than these, over one second",
            ),
        ]
    compared, notes = beside_peers()
    if fast:
        name, each = f"compiled, {BLOCK} random {_DETENTS}, {_ROUGH}", BLOCK * _PERIODS
        rates = [each / one for one in times[_DETENTS]]
        rows.append(over_rounds(name, rates, "wall-periods/s", "a law whose table has more rows"))
        rows += _two_core_rows(drawn)
    else:
        notes.append("nothing is compiled: pip install -e '.[fast]' in the clone adds Numba")
    return Section((*rows, *compared), tuple(notes))


def _in_detents(walls: list[ArrayWall]) -> Callable[[], object]:
    """Return a call that simulates the servos in detents; the table has a row at each peak."""
    many, start, _ = _as_arrays(walls)
    law = Table.of(Detents(_WIDTH, 0.25), _WIDTH * (np.arange(-24, 25) / 2 + 0.25))
    return partial(_run, replace(many, law=law), start, _PERIODS)


def random_walls(rough: bool, count: int) -> list[ArrayWall]:
    """Return walls that differ in everything: servo, delay, stiffness, damping and kick.

    Equal walls reverse in the same period, which costs a fraction of the time of random ones.

    Args:
        rough: With Coulomb friction, an encoder and a torque limit; else linear.
        count: Number of walls.
    """
    random = np.random.default_rng(1)
    inertia = 10 ** random.uniform(-3.0, -1.0, count)
    damping = inertia * random.uniform(0.5, 4.0, count)
    coulomb = random.uniform(0.1, 1.0, count) * inertia
    delay = np.round(random.uniform(0.0, 5.0, count), 3) * PERIOD_S
    ceiling = max_virtual_damping(inertia, damping, PERIOD_S, delay)
    virtual = random.uniform(0.0, 0.5, count) * ceiling
    limit = critical_stiffness(inertia, damping, virtual, PERIOD_S, delay)
    stiffness = random.uniform(0.1, 0.95, count) * limit
    kick = 10 ** random.uniform(-2.0, 0.0, count)
    return [
        ArrayWall(
            TrueServo(
                inertia=m,
                damping=b,
                coulomb=c if rough else 0.0,
                counts_per_rev=4096 if rough else 0,
                torque_limit=50.0 * m if rough else math.inf,
                delay=t_d,
                position=x,
            ),
            k,
            big_b,
        )
        for m, b, c, t_d, x, k, big_b in zip(
            *(a.tolist() for a in (inertia, damping, coulomb, delay, kick, stiffness, virtual)),
            strict=True,
        )
    ]


def together(walls: list[ArrayWall], periods: int, *, compile_: bool = True) -> FloatArray:
    """Return the last measured positions [rad] of walls simulated as one array, in their order."""
    many, start, order = _as_arrays(walls)
    found = np.empty(len(walls))
    found[order] = _run(many, start, periods, compile_=compile_)
    return found


def _run(many: Walls, start: FloatArray, periods: int, *, compile_: bool = True) -> FloatArray:
    loops = Loops(many, start.copy(), compile_=compile_)
    loops.run(periods)
    return loops.measured


def _as_arrays(walls: list[ArrayWall]) -> tuple[Walls, FloatArray, IntArray]:
    """Return one block in order of delays, with the start positions and that order."""
    servos, one = [wall.servo for wall in walls], np.ones(len(walls))
    delay_ns = np.array([round(servo.delay * 1e9) for servo in servos])
    whole, lag_ns = np.divmod(delay_ns, _PERIOD_NS)
    order = np.argsort(whole, kind="stable")
    start = np.array([servo.position for servo in servos])
    many = Walls(
        inertia=np.array([servo.inertia for servo in servos]),
        damping=np.array([servo.damping for servo in servos]),
        coulomb=np.array([servo.coulomb for servo in servos]),
        counts_per_radian=np.array([servo.counts_per_rev / math.tau for servo in servos]),
        backlash=0.0 * one,
        torque_limit=np.array([servo.torque_limit for servo in servos]),
        torque_step=0.0 * one,
        stiffness=np.array([wall.stiffness for wall in walls]),
        virtual_damping=np.array([wall.virtual_damping for wall in walls]),
        period=PERIOD_S * one,
        whole=whole,
        lag=lag_ns * 1e-9,
        rest=(_PERIOD_NS - lag_ns) * 1e-9,
        velocity_samples=np.ones(len(walls), dtype=np.int64),
        one_sided=np.zeros(len(walls), dtype=np.bool_),
    )
    return many.take(order), start[order], order


def _each_alone(walls: list[ArrayWall]) -> list[float]:
    return [alone(wall, _PERIODS_ALONE // _COMPARED) for wall in walls[:_COMPARED]]


def alone(wall: ArrayWall, periods: int) -> float:
    """Return the last measured position [rad] of one simulated servo and wall."""
    clock = SimulatedClock()
    body = open_servo(ServoSettings(true=wall.servo), clock)
    body.start()
    before = math.nan
    for k in range(periods):
        body.request()
        position = body.collect(clock.now_ns()).position
        velocity = (position - before) / PERIOD_S if k else 0.0
        body.write(-wall.stiffness * position - wall.virtual_damping * velocity)
        before = position
        clock.wait_until((k + 1) * _PERIOD_NS)
    body.close()
    return before
