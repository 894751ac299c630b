"""Changes a running wall in the ways that an attacker would: any laws, fast shafts, long delays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.hand import EVERY_NS, FASTEST, MOST_STIFFNESS, Grasp
from scripts.changed_walls import ChangedRun, injected
from scripts.trials.search import Axis

LAWS = (
    "wall",
    "spring",
    "damper",
    "stops",
    "detents",
    "texture",
    "friction",
    "profile",
    "sum",
)
PRESETS = "xm430-w350", "xl330-m288"
CHANGES = 3
"""Changes in a row"""
START = 150
"""Tick of the first change"""
WAIT = 600
"""Longest wait of a change [ticks]"""
BEHIND = 60
"""Ticks behind the last change: the longest delay, and more"""
MOST_STEPS = 50
SECONDS = 1e-3 * (START + CHANGES * (WAIT + 310) + BEHIND)


class Swing:
    """A hand that swings the shaft to and fro.

    Args:
        amplitude: Of the hand [rad].
        hertz: [Hz]
        stiffness: Of the spring between hand and shaft [N·m/rad].
        phase: At the start [turns].
    """

    def __init__(self, amplitude: float, hertz: float, stiffness: float, phase: float) -> None:
        self._rate = math.tau * hertz
        self._amplitude = min(amplitude, FASTEST / self._rate)
        self._stiffness = stiffness
        self._phase = math.tau * phase

    def look(self, now_ns: int) -> Grasp:
        """Return how the hand holds the shaft at a time [ns]."""
        angle = self._rate * now_ns * 1e-9 + self._phase
        place = self._amplitude * math.sin(angle)
        speed = self._amplitude * self._rate * math.cos(angle)
        target = place + speed * EVERY_NS * 1e-9
        return Grasp(now_ns, now_ns + EVERY_NS, place, target, self._stiffness)


class Hostile(NamedTuple):
    """The outcome of a hostile run."""

    energies: tuple[float, ...]
    """Given to the shaft by each change that was made [J]"""
    worst: tuple[str, ...]
    """The first wall, and the change with the largest energy"""

    @property
    def largest(self) -> float:
        """Return the largest energy [J]; 0: none was made, or each took energy."""
        return max(self.energies, default=0.0)


def box(most_steps: int = MOST_STEPS) -> list[Axis]:
    """Return the box of the search: the hand, the servo, the first wall and each change."""
    axes = [
        Axis("preset", 0.0, 1.999),
        Axis("amplitude", 0.01, 1.5, log=True),
        Axis("hertz", 0.3, 12.0, log=True),
        Axis("grip", 1.0, MOST_STIFFNESS, log=True),
        Axis("phase", 0.0, 1.0),
        Axis("gap", 1.0, 300.0),
    ]
    for k in range(CHANGES + 1):
        axes += [
            Axis(f"law{k}", 0.0, len(LAWS) - 1e-3),
            Axis(f"number{k}", 0.0, 1.0),
            Axis(f"stiffness{k}", 0.1, 60.0, log=True),
            Axis(f"damping{k}", 0.0, 0.3),
            Axis(f"steps{k}", 0.0, most_steps + 0.999),
            Axis(f"position{k}", -0.3, 0.3),
            Axis(f"fields{k}", 0.0, 15.999),
        ]
    return axes


def of_law(law: str, number: float) -> tuple[str, ...]:
    """Return the settings of a law, with its number drawn by a value from 0 to 1."""
    high = 0.02 + 0.3 * number
    numbers: dict[str, tuple[str, ...]] = {
        "wall": (f"wall.side={('above', 'below', 'both')[min(2, int(3 * number))]}",),
        "stops": (f"wall.low={-high!r}", f"wall.high={high!r}"),
        "detents": (f"wall.count={8 + int(56 * number)}", "wall.snap=0.3"),
        "texture": (f"wall.period={0.03 + 0.2 * number!r}",),
        "friction": (f"wall.friction={0.02 + 0.3 * number!r}",),
        "profile": ("wall.profile=[[-1, 1], [-0.2, 0.3], [0, 0], [0.3, -0.6], [1, -1]]",),
        "sum": (
            "wall.parts=["
            f"{{law: stops, low: {-high!r}, high: {high!r}, share: {0.2 + 3 * number!r}}},"
            " {law: detents, count: 24, snap: 0.3}]",
        ),
    }
    return (f"wall.law={law}", *numbers.get(law, ()))


def fields_of(point: Mapping[str, float], k: int, now: Config) -> tuple[str, ...]:
    """Return change k of a point of the box, 0: the first wall; it has every field."""
    fields = 15 if k == 0 else int(point[f"fields{k}"]) or 15
    law, number = LAWS[int(point[f"law{k}"])], point[f"number{k}"]
    sets: list[str] = []
    if fields & 1:
        sets += of_law(law, number)
    if fields & 2:
        sets += [f"wall.stiffness={point[f'stiffness{k}']!r}"]
        sets += [f"wall.damping={point[f'damping{k}']!r}"]
    if fields & 4:
        sets += [f"delay.steps={int(point[f'steps{k}'])}"]
    if fields & 8:
        moved = 0.0 if k == 0 else now.wall.position
        sets += [f"wall.position={moved + point[f'position{k}']!r}"]
    return tuple(sets)


def tried(point: Mapping[str, float]) -> Hostile:
    """Run a wall, and change it three times, by a point of the box."""
    first = fields_of(point, 0, load_config("simulated").config)
    try:
        run = attacked(point, first)
    except ConfigError:
        return Hostile((), first)  # the encoder does not resolve the law
    _, rows = run.run(SECONDS)
    since, energies, worst = 0, [], first
    for asked in run.asked:
        if asked.row < 0 or asked.row + BEHIND > len(rows):
            continue
        energies.append(injected(run, rows, asked, since))
        if energies[-1] == max(energies):
            worst = (*first, "->", *asked.sets)
        since = asked.row
    return Hostile(tuple(energies), worst)


def attacked(point: Mapping[str, float], first: Sequence[str]) -> ChangedRun:
    """Return the run of a point of the box, with these settings of its first wall."""
    preset = load_config(PRESETS[int(point["preset"])]).config
    belief = preset.belief()
    sets = [
        "loop.clock=simulated",
        "servo.backend=simulated",
        "servo.hand=none",
        f"servo.torque_limit={preset.servo.torque_limit!r}",
        "servo.counts_per_rev=4096",
        "safety.max_speed=1000",
        "safety.travel=[-1000, 1000]",
        *first,
    ]
    for name in ("inertia", "damping", "coulomb", "delay"):
        bounds = getattr(belief, name)
        sets.append(f"servo.{name}={bounds.value!r}")
        sets.append(
            f"model.{name}={{value: {bounds.value!r}, low: {bounds.low!r}, high: {bounds.high!r}}}"
        )
    gap = int(point["gap"])
    left = list(range(1, CHANGES + 1))
    free = [START]

    def ask(row: int, now: Config, position: float) -> Sequence[str]:  # noqa: ARG001 - any place
        if not left or row < free[0]:
            return ()
        if run.asked and free[0] < run.asked[-1].tick + gap:
            free[0] = row + gap
            return ()
        k = left.pop(0)
        return fields_of(point, k, now)

    swing = Swing(*(point[name] for name in ("amplitude", "hertz", "grip", "phase")))
    run = ChangedRun(load_config("simulated", sets).config, ask, WAIT, hand=swing)
    return run
