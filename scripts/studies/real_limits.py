"""Measures how far a real servo's effects move the true limit from that of the guard.

    scripts/study real_limits [--quick] [--servos NAME ...]

A servo with one effect at a time, then with all of them, on a wall in simulation without the rest
of the program. Two-sided walls: the least stiffness at which a kick of any of three sizes does not
die. One-sided walls: the least at which a shaft thrown in leaves with more energy than it came
with. Both as a share of the limit that the guard computes from inertia, viscous friction and delay
alone, without its margin. Takes some minutes.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.report.style import BLUE, GREY, ORANGE, PAGE, grid, picture
from haptic_wall.controller.theory import critical_stiffness, one_sided_limit
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.settings import TrueServo
from scripts.kicked_walls import PERIOD_NS, PERIOD_S, kicked, least_bad
from scripts.study import Found, Given, Option, Part, Study, table

DELAY = 1e-3
"""Of every servo, beside what its current loop adds [s]"""
KICKS = (0.004, 0.03, 0.3)
"""Displacements from the wall at which a two-sided wall begins [rad]"""
SPEEDS = (0.3, 1.0, 3.0)
"""Of entry into a one-sided wall [rad/s]"""
PHASES = (0.0, 0.33, 0.67, 0.999)
"""Of the entry within a period"""
CYCLES = 20
"""Of a two-sided wall, over which a motion has to die"""
LONGEST, AFTER = 5_000, 15
"""Samples of a contact at most, and of those after it: until delayed torques have ended"""
SHARES = (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.3, 1.6)
"""Stiffnesses that are tried first, over the guard's limit"""
HALVINGS = 4
PICTURE = "real-limits.png"
MARGIN = 0.8


class Base(NamedTuple):
    """A servo's linear figures, from its published fit, and the dampings that are tried."""

    inertia: float
    damping: float
    coulomb: float
    no_load_speed: float
    torque_limit: float
    virtual_dampings: tuple[float, ...]


BASES = {
    "XM430": Base(0.011951, 0.011692, 0.09039, 4.82, 4.1, (0.0, 0.04, 0.2)),
    "XL330": Base(0.0018142, 0.0036617, 0.012833, 10.9, 0.52, (0.0, 0.005, 0.05)),
}


class Effect(NamedTuple):
    """One effect at one size: what it changes of a servo, of which the guard knows nothing."""

    name: str
    size: str
    changes: dict[str, Any]


def effects(base: Base) -> Iterator[Effect]:
    """Every effect at realistic sizes and beyond, and all together."""
    yield Effect("none", "", {})
    yield from frictions(base)
    yield from loads(base)
    yield from encoders(base)
    for hertz in (50.0, 160.0, 500.0):
        size = f"{hertz:g} Hz, counted as a delay"
        yield Effect("current loop", size, {"current_bandwidth": hertz})
    for droop in (0.0, 0.5):
        motor = {"back_emf": True, "no_load_speed": base.no_load_speed}
        yield Effect("back-EMF", f"droop {droop:g}", {**motor, "current_droop": droop})
    band = {"dead_band": 0.03 * base.torque_limit}
    yield Effect("dead band", "3 % of the stall torque", band)
    yield Effect("all", "at usual sizes", everything(base))


def frictions(base: Base) -> Iterator[Effect]:
    """Friction that is larger at rest, not the same each way, or grows with the load."""
    friction = base.coulomb
    for share in (0.5, 1.0, 2.0):
        yield Effect("Coulomb friction", f"{share:g} of the fit's", {"coulomb": share * friction})
    for static, speed in ((1.5, 1.1), (2.5, 1.1), (2.5, 0.05)):
        falling = {"static_friction": static * friction, "stribeck_speed": speed}
        size = f"{static:g} of Coulomb's, over {speed:g} rad/s"
        yield Effect("static friction", size, {"coulomb": friction, **falling})
    for share in (0.5, 0.8, 1.25, 2.0):
        back = {"damping_back": share * base.damping}
        yield Effect("viscous friction backward", f"{share:g} of forward", back)
    for share in (0.1, 0.3):
        yield Effect("load friction", f"{share:g} of the load", {"load_friction": share})


def loads(base: Base) -> Iterator[Effect]:
    """Torques that depend on the position."""
    for share in (0.02, 0.1, 0.25):
        for angle, where in ((0.0, "hangs at the wall"), (math.pi, "stands on end there")):
            weight = {"gravity": share * base.torque_limit, "gravity_angle": angle}
            yield Effect("weight", f"{share:g} of the stall torque, {where}", weight)
    for share, periods in ((0.005, 24.0), (0.01, 24.0), (0.01, 96.0)):
        for phase, where in ((0.0, "stiffest at the wall"), (math.pi, "softest there")):
            teeth = {"cogging": share * base.torque_limit, "cogging_periods": periods}
            size = f"{share:g} of the stall torque, {periods:g} a turn, {where}"
            yield Effect("cogging", size, {**teeth, "cogging_phase": phase})


def encoders(base: Base) -> Iterator[Effect]:
    """Yield the effects between the shaft and its reading."""
    for error in (0.003, 0.01, 0.05):
        yield Effect("eccentric encoder", f"{error:g} rad", {"encoder_eccentricity": error})
    counts = {"counts_per_rev": 4096, "coulomb": base.coulomb}
    yield Effect("encoder's counts", "4096 a turn, with friction", counts)
    for noise in (0.3, 1.0):
        size = f"{noise:g} counts, with friction"
        yield Effect("encoder's noise", size, {"encoder_noise": noise, **counts})
    for degrees in (0.1, 0.25):
        slack = {"backlash": math.radians(degrees), **counts}
        yield Effect("backlash", f"{degrees:g}°, with friction", slack)


def everything(base: Base) -> dict[str, Any]:
    """Every effect at once, each at a size in the middle of what is known."""
    return {
        "coulomb": base.coulomb,
        "static_friction": 1.5 * base.coulomb,
        "stribeck_speed": 1.1,
        "damping_back": 0.8 * base.damping,
        "load_friction": 0.1,
        "gravity": 0.02 * base.torque_limit,
        "cogging": 0.005 * base.torque_limit,
        "encoder_eccentricity": 0.003,
        "encoder_noise": 0.3,
        "counts_per_rev": 4096,
        "current_bandwidth": 160.0,
        "back_emf": True,
        "current_droop": 0.3,
        "no_load_speed": base.no_load_speed,
    }


class Case(NamedTuple):
    """One servo with one effect, on walls of one virtual damping."""

    servo: str
    name: str
    size: str
    virtual_damping: float


class Limits(NamedTuple):
    """The true limits as shares of the guard's; the last of ``SHARES`` where none was found."""

    two_sided: float
    one_sided: float


def servo_of(case: Case) -> TrueServo:
    """The true servo of a case, with room for any torque."""
    base = BASES[case.servo]
    same = (each for each in effects(base) if (each.name, each.size) == (case.name, case.size))
    plain = TrueServo(
        inertia=base.inertia, damping=base.damping, counts_per_rev=0, delay=DELAY, torque_limit=1e3
    )
    changed = next(same).changes
    if changed.get("back_emf"):
        changed = {**changed, "torque_limit": base.torque_limit}
    return replace(plain, **changed)


def counted_delay(true: TrueServo) -> float:
    """The delay that the guard counts [s]."""
    bandwidth = true.current_bandwidth
    return true.delay + (1 / (2 * math.pi * bandwidth) if bandwidth else 0.0)


def grows(true: TrueServo, stiffness: float, virtual_damping: float, kick: float) -> bool:
    """Whether the motion of a kick on a two-sided wall does not die."""
    frequency = math.sqrt(stiffness / true.inertia) / (2 * math.pi)
    count = math.ceil(CYCLES / frequency / PERIOD_S)
    part = count * 3 // CYCLES
    positions = kicked(true, stiffness, virtual_damping, kick, count, furthest=20 * kick + 0.5)
    if positions is None:
        return True
    first, last = (float(np.ptp(at)) for at in (positions[:part], positions[-part:]))
    counts = 8 * 2 * math.pi / true.counts_per_rev if true.counts_per_rev else 0.0
    return last >= first and last > max(counts, 1e-3 * kick)


def throws(
    true: TrueServo, stiffness: float, virtual_damping: float, speed: float, phase: float
) -> bool:
    """Whether a shaft thrown into a one-sided wall leaves with more energy than it came with."""
    period = PERIOD_S
    start = -speed * period * (1 + phase)
    servo = Mechanism(replace(true, position=start), 0, velocity=speed)
    before, outside, came, went = start - speed * period, 0, energy(true, start, speed), -math.inf
    for k in range(LONGEST):
        servo.advance(k * PERIOD_NS)
        x = servo.measured_position()
        torque = -stiffness * x - virtual_damping * (x - before) / period
        servo.command(min(torque, 0.0) if x > 0 else 0.0, k * PERIOD_NS)
        before = x
        outside = outside + 1 if k > 2 and x <= 0 else 0
        went = max(went, energy(true, servo.position, servo.velocity)) if outside else -math.inf
        if outside > AFTER:
            return went > came
    return False  # it stays in the wall


def energy(true: TrueServo, position: float, velocity: float) -> float:
    """Kinetic energy and that of weight and cogging [J]."""
    n = true.cogging_periods
    weight = -true.gravity * math.cos(position - true.gravity_angle)
    teeth = -true.cogging / n * math.cos(n * position + true.cogging_phase)
    return 0.5 * true.inertia * velocity * velocity + weight + teeth


def cases(given: Given) -> list[Case]:
    """Every effect of each servo at each virtual damping."""
    return [
        Case(servo, effect.name, effect.size, damping)
        for servo in given.servos
        for effect in effects(BASES[servo])
        for damping in BASES[servo].virtual_dampings[:: 2 if given.quick else 1]
    ]


def limits(case: Case) -> Limits:
    """The true limits of a case, as shares of what the guard computes."""
    true, big_b = servo_of(case), case.virtual_damping
    base, delay = BASES[case.servo], counted_delay(true)
    linear = (base.inertia, base.damping, big_b, PERIOD_S, delay)
    exact, one_sided = float(critical_stiffness(*linear)), float(one_sided_limit(*linear))
    return Limits(
        least_bad(
            lambda share: any(grows(true, share * exact, big_b, kick) for kick in KICKS),
            SHARES,
            HALVINGS,
        ),
        least_bad(
            lambda share: any(
                throws(true, share * one_sided, big_b, speed, phase)
                for speed in SPEEDS
                for phase in PHASES
            ),
            SHARES,
            HALVINGS,
        ),
    )


def lines(found: Found[Case, Limits]) -> list[str]:
    """A table: the least over the dampings of each effect, and the picture."""
    draw(found)
    servos = list(dict.fromkeys(case.servo for case, _ in found))
    rows = []
    for effect in effects(next(iter(BASES.values()))):
        cells: list[str] = []
        for servo in servos:
            own = [
                (row, case.virtual_damping)
                for case, row in found
                if (case.servo, case.name, case.size) == (servo, effect.name, effect.size)
            ]
            for side in (0, 1):
                share, damping = min((row[side], damping) for row, damping in own)
                more = share >= SHARES[-1]
                cells.append(f"over {SHARES[-1]:g}" if more else f"{share:.2f} (B {damping:g})")
        rows.append((effect.name, effect.size, *cells))
    head = [f"{servo}, {side}" for servo in servos for side in ("two-sided", "one-sided")]
    return [
        f"![The true limit over the guard's, for each effect]({PICTURE})",
        "",
        *table(("effect", "size", *head), *rows),
    ]


def draw(found: Found[Case, Limits]) -> None:
    """Draw the least shares of each effect."""
    names = [f"{each.name} {each.size}".strip() for each in effects(next(iter(BASES.values())))]
    with picture(Path(__file__).parents[2] / "docs" / "evidence" / PICTURE, PAGE, 8.0) as figure:
        ax = figure.subplots()
        for side, colour, word in ((0, BLUE, "two-sided"), (1, ORANGE, "one-sided")):
            xs = [row[side] for _, row in found]
            ys = [names.index(f"{case.name} {case.size}".strip()) for case, _ in found]
            at = np.array(ys) + (0.18 if side else -0.18)
            ax.plot(xs, at, "o", color=colour, markersize=3, alpha=0.7, label=word)
        ax.axvline(1.0, color=GREY, linewidth=0.8)
        ax.axvline(MARGIN, color=GREY, linewidth=0.8, linestyle="--")
        ax.set_yticks(range(len(names)), names, fontsize=6)
        ax.invert_yaxis()
        ax.set_xlim(0.0, SHARES[-1] * 1.02)
        ax.set_xlabel("true limit over the guard's; dashed: the margin of 0.8")
        ax.legend(loc="lower left", fontsize=7)
        grid(ax)


STUDY = Study(
    "evidence/real-limits.md",
    (Part("limits", cases, limits, lines, case_s=6.0),),
    (Option("servos", tuple(BASES), "servos to try", quick=("XM430",)),),
)
