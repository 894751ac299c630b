"""Checks the measured delay against servos whose lag is known.

    scripts/study delay_check [--runs N] [--bursts N] [--quick]

Simulated servos with random lags of fractions of a period, random inserted delays; the emulated bus
in memory; the emulated bus in a process of its own, in real time, behind adapters with and without
a latency timer. Takes about ten minutes, with --quick one.
"""

import math
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.delay import BURSTS, measure_delay
from haptic_wall.controller.experiments.steps.shaken import (
    ExperimentFailedError,
    plan_shaking,
    shake,
)
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.settings.load import load_config
from scripts.study import Found, Given, Option, Part, Study, table, table_of
from scripts.whole_program import emulated_bus

LONGEST = 0.006
SERVOS: dict[str, tuple[str, ...]] = {
    "XM430-like (MX-64's figures)": (),
    "XL330-like": (
        "servo.inertia=0.0018142",
        "servo.damping=0.0036617",
        "servo.coulomb=0.012833",
        "servo.torque_limit=0.52",
        "servo.torque_step=0.0008",
    ),
    "coarse encoder (1024)": ("servo.counts_per_rev=1024",),
    "with 5 mrad of backlash": ("servo.backlash=0.005",),
}
PATIENT = (
    "servo.watchdog_s=2.54",
    "safety.heartbeat_s=10",
    "safety.max_loss=1",
    "safety.max_silence_s=1",
    "realtime.profile=best-effort",
    "servo.torque_limit=4.1",
)
"""With stalls of the machine, which are no part of what is checked"""
ADAPTERS: tuple[tuple[int | None, str], ...] = (
    (None, "immediate"),
    (None, "pipelined"),
    (1, "pipelined"),
)
"""Latency timer [ms] and schedule; with a timer no reply comes within the period it is asked in"""
LAG = 0.00137
ATTEMPTS = 3


class Shaken(NamedTuple):
    """A servo to measure in memory."""

    name: str
    sets: tuple[str, ...]
    preset: str
    seed: int
    bursts: int


def shaken(given: Given) -> list[Shaken]:
    """So many runs of each servo, and a quarter of them on the emulated bus in memory."""
    servos = [(name, sets, "simulated", given.runs) for name, sets in SERVOS.items()]
    memory = ("emulated bus, in memory", (), "emulated-ideal", math.ceil(given.runs / 4))
    return [
        Shaken(name, sets, preset, seed, given.bursts)
        for name, sets, preset, runs in (*servos, memory)
        for seed in range(runs)
    ]


def measured(case: Shaken) -> tuple[float, float]:
    """Error of one measured lag, and its standard error [s]."""
    random = np.random.default_rng([case.seed, len(case.name)])
    lag = float(random.uniform(0.0, LONGEST))
    config = load_config(
        case.preset,
        (
            "loop.clock=simulated",
            "servo.hand=none",
            f"servo.delay={lag}",
            f"delay.steps={int(random.integers(0, 6))}",
            f"model.delay={{value: {lag}, low: 0, high: {LONGEST}}}",
            *case.sets,
        ),
    ).config
    limit = config.servo.torque_limit or 4.1
    shaking = plan_shaking(config, limit, config.delay.steps, case.bursts, case.seed)
    with tempfile.TemporaryDirectory() as folder:
        fit = shake(Testbed(config, Path(folder)), "steps", shaking).fit
    return fit.lag - lag, fit.stderr


def servos(found: Found[Shaken, tuple[float, float]]) -> list[str]:
    """A line for each servo."""
    rows = []
    for name in dict.fromkeys(case.name for case, _ in found):
        error, stderr = np.array([row for case, row in found if case.name == name]).T
        off = error / stderr
        rows.append(
            [
                *(name, f"{error.size}", f"{1e6 * np.mean(error):+.0f}"),
                f"{1e6 * np.sqrt(np.mean(error**2)):.0f}",
                f"{1e6 * np.max(np.abs(error)):.0f}",
                f"{1e6 * np.median(stderr):.0f}",
                *(f"{np.mean(np.abs(off) < 2.0):.0%}", f"{np.sqrt(np.mean(off**2)):.2f}"),
            ]
        )
    head = ["servo", "runs", "mean error, µs", "rms error, µs", "largest, µs"]
    return table([*head, "stderr given (median), µs", "within two", "off"], *rows)


class Adapter(NamedTuple):
    """Where the emulated bus is measured in real time."""

    timer_ms: int | None
    schedule: str
    inserted: int
    bursts: int
    seed: int


def in_real_time(case: Adapter) -> list[str]:
    """One line of the table: the driver in a process of its own, against the bus in another."""
    timer_ms, schedule, inserted, bursts, seed = case
    words = ["--servo", "XM430-W350", "--set", f"servo.delay={LAG}"]
    if timer_ms is not None:
        words += ["--latency-timer", str(timer_ms)]
    adapter = "no adapter" if timer_ms is None else f"latency timer {timer_ms} ms"
    adapter += f", {schedule}"
    for _ in range(ATTEMPTS):
        try:
            with emulated_bus(*words) as bus, tempfile.TemporaryDirectory() as folder:
                config = load_config(
                    "xm430-w350",
                    (
                        *PATIENT,
                        f"servo.port={bus.port}",
                        f"servo.schedule={schedule}",
                        f"delay.steps={inserted}",
                        "wall.position=10",
                    ),
                ).config
                found = measure_delay(config, Path(folder), [0], bursts, seed)
        except (ExperimentTrippedError, ExperimentFailedError) as error:
            print(f"{adapter}: {error}; again", file=sys.stderr)
            continue
        recovered = found.points[-1].recovered
        assert recovered is not None
        device = found.device
        return [
            adapter,
            f"{1e3 * found.age_median:.2f}",
            f"{LAG * 1e3:.3f}",
            f"{1e3 * device.value:.3f} ± {1e3 * device.stderr:.3f}",
            f"{(device.value - LAG) / device.stderr:+.1f}",
            f"{inserted}",
            f"{1e3 * recovered.value:.3f} ± {1e3 * recovered.stderr:.3f}",
            f"{(recovered.value - inserted * config.period_s) / recovered.stderr:+.1f}",
        ]
    ended = f"{ATTEMPTS} runs ended early"
    return [adapter, "-", f"{LAG * 1e3:.3f}", ended, "-", f"{inserted}", "-", "-"]


STUDY = Study(
    "evidence/delay-check.md",
    (
        Part("memory", shaken, measured, servos, case_s=1.5),
        Part(
            "real-time",
            lambda given: [
                Adapter(*each, 3, given.bursts, 10 * i)
                for i, each in enumerate(ADAPTERS[: given.adapters])
            ],
            in_real_time,
            table_of(
                "adapter|age of a sample (median), ms|true lag, ms|measured, ms|off"
                "|periods inserted|recovered, ms|off"
            ),
            case_s=60.0,
            in_turn=True,
        ),
    ),
    (
        Option("runs", 60, "runs of each simulated servo", quick=4),
        Option("bursts", BURSTS, "bursts of torque steps in each run"),
        Option("adapters", 3, "adapters that are emulated in real time", quick=1),
    ),
)
