"""Changes random walls in contact at random, and measures the energy that the shaft gets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.settings.changes import moved
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.support.changed_walls import Asked, ChangedRun, injected

GAP = 300
"""Ticks between the end of a change and the next one"""
WAIT = 10_000
"""Longest wait [ticks]: the default of the command"""
_BEHIND = 20
"""Least number of rows behind a change that is judged: the longest delay, and more"""
LAWS = "wall", "spring", "stops", "detents", "texture", "friction", "profile"
KINDS = (
    "stiffness up",
    "stiffness down",
    "damping",
    "position",
    "delay up",
    "delay down",
    "law",
    "several",
)


@dataclass(frozen=True, slots=True)
class Bench:
    """A run."""

    preset: str
    hand: str
    seed: int


class One(NamedTuple):
    """A change."""

    kind: str
    made: bool
    waited_s: float
    energy: float
    """Given to the shaft [J]; 0: not made"""
    why: str
    """Last reason to wait"""


class Row(NamedTuple):
    """Of a run."""

    changes: tuple[One, ...]
    ended: str


def tried(bench: Bench, seconds: float) -> Row:
    """Run a wall, and change it.

    Args:
        bench: The run.
        seconds: Its duration [s].
    """
    random = np.random.default_rng([bench.seed, *bench.preset.encode(), *bench.hand.encode()])
    config = _config(bench, random)
    kinds: list[str] = []
    free = [0]

    def ask(row: int, now: Config, position: float) -> Sequence[str]:
        if run.asked and run.asked[-1].tick >= free[0]:
            free[0] = row + GAP
        if row < free[0] or row < 2 * GAP or not _touches(now, position):
            return ()
        free[0] = row
        kind, sets = _drawn(random, now)
        kinds.append(kind)
        return sets

    run = ChangedRun(config, ask, WAIT)
    result, rows = run.run(seconds)
    since = 0
    found = []
    for kind, asked in zip(kinds, run.asked, strict=True):
        if asked.refused:
            raise AssertionError(asked.refused)
        if asked.number:
            continue  # the run ended while it waited
        energy = injected(run, rows, asked, since) if asked.row >= 0 else 0.0
        if _same(rows, asked) or asked.row + _BEHIND > len(rows):
            continue
        waited = (asked.row - asked.tick) * config.period_s if asked.row >= 0 else WAIT * 1e-3
        found.append(One(kind, asked.row >= 0, waited, energy, asked.obstacle.name.lower()))
        since = asked.row if asked.row >= 0 else since
    return Row(tuple(found), str(result.stop_reason))


def _config(bench: Bench, random: np.random.Generator) -> Config:
    """Return a wall on a servo drawn inside the belief of a preset."""
    preset = load_config(bench.preset).config
    belief, limit = preset.belief(), preset.servo.torque_limit
    sets = [
        "loop.clock=simulated",
        "servo.backend=simulated",
        f"servo.hand={bench.hand}",
        f"servo.torque_limit={limit!r}",
        "servo.counts_per_rev=4096",
        f"wall.stiffness={10.0 ** random.uniform(-0.5, 0.7):.4g}",
        f"wall.damping={random.choice([0.0, random.uniform(0.0, 0.03)]):.4g}",
        f"delay.steps={max(0, int(random.integers(-4, 5)))}",
    ]
    for name in ("inertia", "damping", "coulomb", "delay"):
        bounds = getattr(belief, name)
        corner = random.random() < 0.5
        true = random.choice([bounds.low, bounds.high]) if corner else None
        true = random.uniform(bounds.low, bounds.high) if true is None else true
        sets.append(f"servo.{name}={float(true)!r}")
        sets.append(
            f"model.{name}={{value: {bounds.value!r}, low: {bounds.low!r}, high: {bounds.high!r}}}"
        )
    return load_config("simulated", sets).config


def _same(rows: NDArray[np.void], asked: Asked) -> bool:
    """Whether the guard commands the same as before: it allows neither more."""
    if asked.row < 0 or asked.new is None:
        return False
    before, after = rows[asked.tick - 1], rows[asked.row]
    gains = all(before[name] == after[name] for name in ("stiffness", "damping"))
    same = asked.before.delay == asked.new.delay and not moved(asked.before, asked.new)
    return gains and same


def _touches(config: Config, position: float) -> bool:
    """Whether the law holds energy at a position."""
    law = config.law(0.0)
    return law.in_contact(position) and abs(law.elongation(position)) > 2e-3


def _drawn(random: np.random.Generator, now: Config) -> tuple[str, tuple[str, ...]]:
    """Draw a change."""
    kind = str(random.choice(KINDS))
    wall, steps = now.wall, now.delay.steps
    stiffness = wall.stiffness
    if kind == "delay down" and steps == 0:
        kind = "delay up"
    match kind:
        case "stiffness up":
            return kind, (f"wall.stiffness={min(stiffness * random.uniform(1.1, 4.0), 8.0):.5g}",)
        case "stiffness down":
            return kind, (f"wall.stiffness={stiffness * random.uniform(0.1, 0.9):.5g}",)
        case "damping":
            return kind, (f"wall.damping={random.uniform(0.0, 0.05):.5g}",)
        case "position":
            return kind, (f"wall.position={wall.position + random.normal(0.0, 0.05):.5g}",)
        case "delay up":
            return kind, (f"delay.steps={min(steps + int(random.integers(1, 4)), 6)}",)
        case "delay down":
            return kind, (f"delay.steps={int(random.integers(0, steps))}",)
        case "law":
            return kind, _law(random, wall.law)
    return kind, (
        f"wall.stiffness={10.0 ** random.uniform(-0.5, 0.7):.5g}",
        f"wall.damping={random.uniform(0.0, 0.05):.5g}",
        f"wall.position={random.normal(0.0, 0.05):.5g}",
        f"delay.steps={int(random.integers(0, 6))}",
    )


def _law(random: np.random.Generator, now: str) -> tuple[str, ...]:
    """Draw another law."""
    law = str(random.choice([each for each in LAWS if each != now]))
    numbers = {
        "wall": (),
        "spring": (),
        "stops": ("wall.low=-1", f"wall.high={random.uniform(-0.1, 0.1):.4g}"),
        "detents": (
            f"wall.count={random.integers(8, 64)}",
            f"wall.snap={random.uniform(0.1, 0.4):.3g}",
        ),
        "texture": (f"wall.period={random.uniform(0.03, 0.2):.4g}",),
        "friction": (f"wall.friction={random.uniform(0.02, 0.2):.3g}",),
        "profile": ("wall.profile=[[-1, 1], [-0.2, 0.3], [0, 0], [0.3, -0.6], [1, -1]]",),
    }[law]
    return (f"wall.law={law}", *numbers)
