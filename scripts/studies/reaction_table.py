"""Measures the answers to oscillations.

    scripts/study reaction_table

On the simulated clock with the loop's own tick: random servos, delays, virtual dampings, kicks and
beliefs; the same seed gives the same figures on every machine.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.maps.onset import simulated_critical_stiffness
from haptic_wall.controller.guard.schedule import GainSchedule
from haptic_wall.controller.guard.types import Decision
from haptic_wall.controller.runtime.assembly import (
    guard_schedule,
    most_injected,
    rendered,
    tick_parts,
)
from haptic_wall.controller.runtime.telemetry import FLAG_SATURATED, Telemetry
from haptic_wall.controller.runtime.tick import Tick
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, peak
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.servos import SERVOS
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_servo
from scripts.study import Found, Given, Option, Part, Study
from scripts.trials.laws import LAW_GROWTH
from scripts.trials.own_walls import GROWTH
from scripts.trials.passive_ceiling import PASSIVE
from scripts.trials.sections import GENERATIONS, WALLS_TRIED
from scripts.trials.truth import COUNT
from scripts.trials.worst import WORST

PERIOD = 1e-3
PLANTS = {
    **{name: (s.inertia, s.damping, s.coulomb) for name, s in SERVOS.items()},
    "Table II": (1.0, 0.1, 0.0),
}
QUANTISATION_SHARE = 0.1
TORQUE_LIMITS = {
    name: 40.0 * coulomb if coulomb else 100.0 for name, (_, _, coulomb) in PLANTS.items()
}
WRONG = 0.2
"""How far a belief may be from the truth"""
CYCLES = 12
CASE_S = 0.15
"""Time to simulate one case on one core [s]"""


@dataclass(frozen=True, slots=True)
class Case:
    """One servo, kicked at one wall."""

    plant: str
    inertia: float
    damping: float
    coulomb: float
    delay: float
    virtual_damping: float
    kick: float
    torque_limit: float
    stiffness: float
    ratio: float
    """Stiffness in the terms of what it is compared with"""
    belief: tuple[float, float, float, float]
    """Factors on inertia, damping, Coulomb friction and delay"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a case; amplitudes [rad]."""

    alarm_s: float
    at_alarm: float
    """The largest amplitude until then"""
    largest: float
    """Over the whole run"""
    late: float
    """The largest after five cycles"""
    tripped: bool
    saturated: bool


def _drawn(rng: np.random.Generator, count: int) -> list[dict[str, Any]]:
    """Servos, delays, dampings and kicks; the stiffness is still open."""
    drawn = []
    names = list(PLANTS)
    for i in range(count):
        name = names[i % len(names)]
        m, b, c = PLANTS[name]
        delay = rng.uniform(0.0, 0.010)
        limit = TORQUE_LIMITS[name]
        ceiling = float(max_virtual_damping(m, b, PERIOD, delay))
        most = min(0.5 * ceiling, QUANTISATION_SHARE * limit * PERIOD / COUNT)
        drawn.append(
            {
                "plant": name,
                "inertia": m,
                "damping": b,
                "coulomb": c,
                "delay": delay,
                "virtual_damping": rng.uniform(0.0, most) if rng.random() < 0.8 else 0.0,
                "kick": math.exp(rng.uniform(math.log(10 * COUNT), math.log(0.3))),
                "torque_limit": limit,
            }
        )
    return drawn


def _belief(rng: np.random.Generator) -> tuple[float, float, float, float]:
    return tuple(rng.uniform(1.0 - WRONG, 1.0 + WRONG, 4))


def beyond_the_limit(rng: np.random.Generator, count: int) -> list[Case]:
    """Walls at 1.2 to 3 times the stiffness above which that kick grows."""
    drawn = _drawn(rng, count)
    columns = {key: np.array([one[key] for one in drawn]) for key in drawn[0] if key != "plant"}
    columns.pop("torque_limit")
    critical = simulated_critical_stiffness(
        columns.pop("inertia"),
        columns.pop("damping"),
        columns.pop("virtual_damping"),
        PERIOD,
        columns.pop("delay"),
        position_step=COUNT,
        tolerance=0.01,
        coulomb=columns.pop("coulomb"),
        kick=columns.pop("kick"),
    )
    cases = []
    for one, limit in zip(drawn, critical, strict=True):
        ratio = math.exp(rng.uniform(math.log(1.2), math.log(3.0)))
        if not (0.0 < limit < math.inf):
            continue
        # Without a torque limit: it would end the growth, and be no merit of the wall's.
        loose = {**one, "torque_limit": 1e6}
        cases.append(Case(**loose, stiffness=ratio * limit, ratio=ratio, belief=_belief(rng)))
    return cases


def below_and_above_the_peak(rng: np.random.Generator, count: int) -> list[Case]:
    """Walls above their critical stiffness, up to twice the peak of the boundary.

    Their ``ratio`` is to the stiffness that damping makes stable at best: at the peak, and negative
    where the encoder's counts forbid as much damping and what they allow is not enough.
    """
    cases: list[Case] = []
    while len(cases) < count:
        for one in _drawn(rng, count):
            m, b, delay = one["inertia"], one["damping"], one["delay"]
            limit = float(critical_stiffness(m, b, one["virtual_damping"], PERIOD, delay))
            top = peak(m, b, PERIOD, delay)
            counted = QUANTISATION_SHARE * one["torque_limit"] * PERIOD / COUNT
            damping = min(float(top.virtual_damping), max(counted, one["virtual_damping"]))
            allowed = float(critical_stiffness(m, b, damping, PERIOD, delay))
            highest = 2.0 * float(top.stiffness)
            stiffness = math.exp(rng.uniform(math.log(1.2 * limit), math.log(highest)))
            room = 0.5 * one["torque_limit"] / stiffness
            share = stiffness / float(top.stiffness)
            if room < 10 * COUNT or stiffness < 1.2 * limit or 0.9 < share < 1.1:
                continue
            if share < 1.0 and stiffness > 0.9 * allowed:
                share = -share
            kicked = {**one, "kick": min(one["kick"], room)}
            cases.append(Case(**kicked, stiffness=stiffness, ratio=share, belief=_belief(rng)))
    return cases[:count]


def _config(case: Case, *sets: str) -> Config:
    m, b, c, d = case.belief
    # What a count may command, of the servo's torque limit even where the case has none.
    share = QUANTISATION_SHARE * TORQUE_LIMITS[case.plant] / case.torque_limit
    values = {
        "loop.clock": "simulated",
        "wall.side": "both",
        "wall.stiffness": case.stiffness,
        "wall.damping": case.virtual_damping,
        "safety.max_speed": 1e6,
        "servo.hand": "none",
        "servo.inertia": case.inertia,
        "servo.damping": case.damping,
        "servo.coulomb": case.coulomb,
        "servo.counts_per_rev": 4096,
        "servo.delay": case.delay,
        "servo.kick": case.kick,
        "servo.torque_limit": case.torque_limit,
        "model.inertia": m * case.inertia,
        "model.damping": b * case.damping,
        "model.coulomb": c * case.coulomb,
        "model.delay": d * case.delay,
        "guard.quantisation_share": share,
    }
    texts = [f"{path}={value}" for path, value in values.items()]
    return load_config("simulated", [*texts, *sets]).config


def _play(config: Config, case: Case) -> Outcome:
    """Run the tick with the stiffness that is asked for, whatever the guard would say."""
    clock, telemetry = SimulatedClock(), Telemetry.create()
    servo = open_servo(config.servo_settings(), clock, None)
    servo.start()
    allowed = guard_schedule(config, servo, simulated=True)
    decision: Decision = _as_asked(allowed.decision, case)
    schedule = GainSchedule([[decision]], [0], [1_000_000], 90.0, 1000)
    law, injected = rendered(config, clock, servo, ()), most_injected(config, servo, schedule)
    parts = tick_parts(config, clock, servo, telemetry, schedule, law, injected)
    tick = Tick(parts)
    tick.wall_on()
    cycle = math.tau * math.sqrt(case.inertia / case.stiffness) / PERIOD
    ticks = min(round(CYCLES * cycle) + 200, 20_000)
    deadline = clock.now_ns()
    for _ in range(ticks):
        deadline += 1_000_000
        clock.wait_until(deadline)
        tick.run(deadline, deadline, 0)
        if tick.trip is not None:
            break
    servo.close()
    rows = telemetry.read(0)[0]
    position: FloatArray = rows["position"]
    away = np.abs(position)
    alarm_s = parts.motion.watch.first_alarm_s
    alarm = len(away) if math.isnan(alarm_s) else max(1, round(alarm_s / PERIOD))
    five = round(5 * cycle)
    return Outcome(
        alarm_s=alarm_s,
        at_alarm=float(away[:alarm].max()),
        largest=float(away.max()),
        late=float(away[five:].max()) if len(away) > five else math.nan,
        tripped=tick.trip is not None,
        saturated=bool(np.any(rows["flags"][round(0.5 * cycle) :] & FLAG_SATURATED)),
    )


def _as_asked(decision: Decision, case: Case) -> Decision:
    return replace(decision, stiffness=case.stiffness, damping=case.virtual_damping)


def reduced(case: Case) -> Outcome:
    """With ``safety.on_oscillation`` at ``reduce``."""
    return _play(_config(case), case)


def controlled(case: Case) -> Outcome:
    """With passivity control; an alarm trips."""
    sets = ("wall.passivity_control=true", "safety.on_oscillation=trip", "guard.mode=off")
    return _play(_config(case, *sets), case)


def _share(hits: int, total: int) -> str:
    return f"{hits} of {total} ({100 * hits / total:.1f} %)" if total else "none"


def walls(given: Given) -> list[tuple[str, Case]]:
    """Draw the cases of both answers."""
    random = np.random.default_rng(given.seed)
    beyond = beyond_the_limit(random, given.cases)
    peaks = below_and_above_the_peak(random, given.cases)
    return [*(("reduce", case) for case in beyond), *(("passivity", case) for case in peaks)]


def answered(case: tuple[str, Case]) -> Outcome:
    """Run a case with the answer that is tried on it."""
    answer, wall = case
    return reduced(wall) if answer == "reduce" else controlled(wall)


def _held_between(
    cases: list[Case], outcomes: list[Outcome], low: float, high: float
) -> tuple[int, int]:
    """How many of the alarmed cases in a range of ratios were held to 1.5 times, of how many."""
    of = [
        outcome
        for case, outcome in zip(cases, outcomes, strict=True)
        if low <= case.ratio < high and not math.isnan(outcome.alarm_s)
    ]
    return sum(o.largest <= 1.5 * max(o.at_alarm, COUNT) for o in of), len(of)


def lines(found: Found[tuple[str, Case], Outcome]) -> list[str]:
    """The part of the page on both answers, wall by wall."""
    beyond = [case for (answer, case), _ in found if answer == "reduce"]
    after_reduce = [outcome for (answer, _), outcome in found if answer == "reduce"]
    peaks = [(case, outcome) for (answer, case), outcome in found if answer != "reduce"]
    alarmed = [o for o in after_reduce if not math.isnan(o.alarm_s)]
    held = [o for o in alarmed if o.largest <= 1.5 * max(o.at_alarm, COUNT)]
    ended = [o for o in alarmed if o.tripped]
    worst = max((o.largest / o.at_alarm for o in alarmed), default=math.nan)
    below = [(c, o) for c, o in peaks if 0.0 < c.ratio < 1.0]
    coarse = [(c, o) for c, o in peaks if c.ratio < 0.0]
    above = [(c, o) for c, o in peaks if c.ratio > 1.0]
    good = [
        (c, o) for c, o in below if not o.tripped and not o.saturated and o.late <= 1.5 * c.kick
    ]
    small = [(c, o) for c, o in below if o.tripped and o.largest <= 1.5 * c.kick + COUNT]
    tripped = [(c, o) for c, o in above if o.tripped]
    forbidden = [(c, o) for c, o in coarse if o.tripped or o.late <= 1.5 * c.kick]
    quiet = [(c, o) for c, o in above if not o.tripped and o.late <= 1.5 * c.kick]
    return [
        f"Random walls on {', '.join(PLANTS)}: delays 0 to 10 ms with fractions, virtual damping 0"
        " to half its ceiling where a count of it stays under a tenth of the torque limit (40 times"
        " the Coulomb friction; 100 N·m for Table II), 4096 counts, kicks of 10 counts to 0.3 rad,"
        f" beliefs wrong by up to {100 * WRONG:.0f} % each.",
        "",
        "| what | result |",
        "|---|---|",
        f"| `reduce`, walls at 1.2 to 3 times the limit of their kick: alarms | "
        f"{_share(len(alarmed), len(beyond))} |",
        f"| of these: amplitude never above 1.5 times that at the alarm | "
        f"{_share(len(held), len(alarmed))}; the worst {worst:.2f} times |",
        *(
            f"| of these, {low:g} to {high:g} times the limit | "
            f"{_share(*_held_between(beyond, after_reduce, low, high))} |"
            for low, high in pairwise((1.2, 1.5, 2.0, 3.0))
        ),
        f"| of these: ended by a trip, since reducing did not help | "
        f"{_share(len(ended), len(alarmed))} |",
        f"| passivity control, walls above their limit and below 0.9 of what damping makes stable"
        " (the peak of the boundary, or what a count may command): at most 1.5 times the kick after"
        f" five cycles, no trip, no saturation | "
        f"{_share(len(good), len(below))} |",
        f"| of these walls: tripped though the amplitude stayed below 1.5 times the kick | "
        f"{_share(len(small), len(below))} |",
        "| walls between that and the peak, where a count would command too much: a trip, or at"
        f" most 1.5 times the kick | {_share(len(forbidden), len(coarse))} |",
        f"| walls at 1.1 to 2 times the peak: a trip | {_share(len(tripped), len(above))} |",
        f"| of these walls: no trip, at most 1.5 times the kick after five cycles | "
        f"{_share(len(quiet), len(above))} |",
    ]


STUDY = Study(
    "evidence/reaction-table.md",
    (Part("belief", walls, answered, lines, case_s=0.15), GROWTH, LAW_GROWTH, WORST, PASSIVE),
    (
        Option("cases", 300, "walls of each kind, for each belief", quick=4),
        Option("seed", 1, "seed of the walls"),
        WALLS_TRIED,
        GENERATIONS,
    ),
    compilable=True,
)
