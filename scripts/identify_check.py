"""Identifies simulated servos whose truth is known, and writes docs/identify-check.md.

    scripts/identify_check [--seeds N] [--quick] [--out FILE]

Each seed draws a servo: inertia, damping and friction up to 20 % from those of its model, a lag
from 0 to 5 ms, and a position between two counts of the encoder. The belief stays that of the
model. On the simulated clock: the same seeds give the same figures on every machine.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controller.benchmarks.machine import machine, versions
from controller.experiments.identification import Identified, identify
from controller.settings.config import Config
from controller.settings.load import load_config
from scripts.whole_program import page_options, say_time

SEEDS, QUICK = 50, 5
SERVO_S = 3.5
"""What one servo takes"""
SPREAD = 0.2
LONGEST_S = 5e-3
NAMES = ("inertia", "damping", "coulomb", "delay")
WANTED = 0.05, 0.1, 0.9
"""Share of a value, share of a period, share of the seeds within two standard errors"""


class Kind(NamedTuple):
    """A servo as its data say it is."""

    name: str
    like: str
    inertia: float
    damping: float
    coulomb: float
    torque_limit: float


KINDS = (
    Kind("XL330-like", "XL330-M288", 0.0018142, 0.0036617, 0.012833, 0.52),
    Kind("XM430-like", "MX-64, its sister", 0.011951, 0.011692, 0.09039, 4.1),
)


class Case(NamedTuple):
    """One servo and what was found of it, in the order of ``NAMES``."""

    truth: tuple[float, ...]
    found: tuple[float, ...]
    stderr: tuple[float, ...]


def drawn(kind: Kind, seed: int) -> Config:
    """The configuration of a seed's servo, with its model's belief."""
    random = np.random.default_rng(seed)
    inertia, damping, coulomb = random.uniform(1 - SPREAD, 1 + SPREAD, 3).tolist()
    delay = float(random.uniform(0.0, LONGEST_S))
    between = float(random.uniform(0.0, math.tau / 4096))
    sets = [
        "loop.clock=simulated",
        "wall.side=both",
        f"servo.inertia={kind.inertia * inertia}",
        f"servo.damping={kind.damping * damping}",
        f"servo.coulomb={kind.coulomb * coulomb}",
        f"servo.delay={delay}",
        f"servo.kick={between}",
        f"servo.torque_limit={kind.torque_limit}",
        "servo.torque_step=0",
        f"model.delay={{value: {LONGEST_S / 2}, low: 0.0, high: {LONGEST_S}}}",
    ]
    for name in NAMES[:3]:
        value = getattr(kind, name)
        bounds = f"{{value: {value}, low: {(1 - SPREAD) * value}, high: {(1 + SPREAD) * value}}}"
        sets.append(f"model.{name}={bounds}")
    return load_config("simulated", sets).config


def case(config: Config, folder: Path) -> Case:
    """Identify one servo."""
    found: Identified = identify(config, folder)
    estimates = [getattr(found, name) for name in NAMES]
    return Case(
        tuple(getattr(config.servo, name) for name in NAMES),
        tuple(e.value for e in estimates),
        tuple(e.stderr for e in estimates),
    )


def rows(kind: Kind, cases: list[Case]) -> list[str]:
    """A row for each value: how far off, how uncertain, how often within two standard errors."""
    lines = []
    for n, name in enumerate(NAMES):
        off = np.array([abs(c.found[n] - c.truth[n]) for c in cases])
        error = np.array([c.stderr[n] for c in cases])
        if name == "delay":
            off, error, unit, wanted = 1e3 * off, 1e3 * error, "ms", f"{WANTED[1]:g} ms"
        else:
            truth = np.array([c.truth[n] for c in cases])
            off, error, unit, wanted = (
                100 * off / truth,
                100 * error / truth,
                "%",
                f"{100 * WANTED[0]:g} %",
            )
        within = int(np.count_nonzero(off <= 2 * error))
        lines.append(
            f"| {kind.name} | {name} | {np.median(off):.3f} {unit} | {np.max(off):.3f} {unit} |"
            f" {wanted} | {np.median(error):.3f} {unit} | {within} of {len(cases)} |"
        )
    return lines


def holds(cases: list[Case]) -> bool:
    """Whether all that is wanted was met."""
    off = np.array([np.abs(np.subtract(c.found, c.truth)) for c in cases])
    truth, stderr = (np.array([getattr(c, name) for c in cases]) for name in ("truth", "stderr"))
    near = np.all(off[:, :3] <= WANTED[0] * truth[:, :3]) and np.all(off[:, 3] <= WANTED[1] * 1e-3)
    within = np.mean(off <= 2 * stderr, axis=0)
    return bool(near and np.all(within >= WANTED[2]))


def page(found: list[tuple[Kind, list[Case]]], seconds: float) -> str:
    """The page."""
    count = len(found[0][1])
    about = machine()
    lines = [
        "# Identification, checked",
        "",
        "Written by `scripts/identify_check`. Simulated servos whose truth is known are identified"
        " by [`haptic-wall identify`](identify.md): encoder of 4096 counts, 1 kHz, inertia, damping"
        f" and friction up to {100 * SPREAD:g} % from what is believed, a lag from 0 to"
        f" {1e3 * LONGEST_S:g} ms with all its fractions, and a start anywhere between two counts.",
        "",
        f"Seeds 0 to {count - 1} of each servo, {seconds / (count * len(found)):.1f} s each on"
        f" {about['processor']}, {about['cores']} cores, {about['system']}, Python"
        f" {versions()['python']}, NumPy {versions()['numpy']}. The figures themselves depend on"
        " the seeds alone.",
        "",
        "| servo | value | off, median | off, worst | wanted | standard error, median |"
        " truth within two |",
        "|---|---|---|---|---|---|---|",
        *(row for kind, cases in found for row in rows(kind, cases)),
        "",
        *(f"{kind.name}: {kind.like} as identified by Rhoban's *bam*." for kind in KINDS),
        "",
        f"Wanted besides: the truth within two standard errors at least {100 * WANTED[2]:g} % of"
        f" the time. {'It holds.' if all(holds(c) for _, c in found) else 'It does not hold.'}",
    ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify them all, and write the page."""
    parser = page_options("identify_check", __doc__, "identify-check.md")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="servos of each kind")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} seeds")
    options = parser.parse_args(arguments)
    seeds = QUICK if options.quick else options.seeds
    say_time(SERVO_S * seeds * len(KINDS))
    found = []
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            cases = []
            for seed in range(seeds):
                cases.append(case(drawn(kind, seed), Path(folder)))
                print(f"{kind.name} {seed + 1}/{seeds}", file=sys.stderr)
            found.append((kind, cases))
    text = page(found, time.monotonic() - began)
    options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
