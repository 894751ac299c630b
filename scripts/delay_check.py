"""Checks the measured delay against servos whose lag is known, and writes docs/delay-check.md.

    scripts/delay_check [--runs N] [--bursts N] [--quick] [--out FILE]

Simulated servos with random lags of fractions of a period, random inserted delays; the emulated bus
in memory; the emulated bus in a process of its own, in real time, behind adapters with and without
a latency timer. Takes about ten minutes, with --quick one.
"""

import math
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from haptic_wall.controller.experiments.delay import BURSTS, measure_delay
from haptic_wall.controller.experiments.steps.shaken import (
    ExperimentFailedError,
    plan_shaking,
    shake,
)
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.settings.load import load_config
from scripts.whole_program import emulated_bus, measured_on, page_options

LONGEST = 0.006
SERVOS = {
    "XM430-like (MX-64's figures)": (),
    "XL330-like": (
        "servo.inertia=0.0018142",
        "servo.damping=0.0036617",
        "servo.coulomb=0.012833",
        "servo.torque_limit=0.52",
        "servo.torque_step=0.0008",
    ),
    "coarse encoder (1024)": ("servo.counts_per_rev=1024",),
    "with 5 mrad of play": ("servo.backlash=0.005",),
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
ADAPTERS = ((None, "immediate"), (None, "pipelined"), (1, "pipelined"))
"""Latency timer [ms] and schedule; with a timer no reply comes within the period it is asked in"""
LAG = 0.00137
ATTEMPTS = 3


def simulated(name: str, sets: tuple[str, ...], runs: int, preset: str, bursts: int) -> str:
    """One line of the table: many lags on one servo."""
    errors, claimed = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(runs):
            random = np.random.default_rng([seed, len(name)])
            lag = float(random.uniform(0.0, LONGEST))
            config = load_config(
                preset,
                (
                    "loop.clock=simulated",
                    "servo.hand=none",
                    f"servo.delay={lag}",
                    f"delay.steps={int(random.integers(0, 6))}",
                    f"model.delay={{value: {lag}, low: 0, high: {LONGEST}}}",
                    *sets,
                ),
            ).config
            shaking = plan_shaking(
                config, config.servo.torque_limit or 4.1, config.delay.steps, bursts, seed
            )
            fit = shake(Testbed(config, Path(folder)), "steps", shaking).fit
            errors.append(fit.lag - lag)
            claimed.append(fit.stderr)
            print(f"{name}: {1e6 * errors[-1]:+.0f} of {1e6 * claimed[-1]:.0f} µs", file=sys.stderr)
    error, stderr = np.array(errors), np.array(claimed)
    off = error / stderr
    return (
        f"| {name} | {runs} | {1e6 * np.mean(error):+.0f} | {1e6 * np.sqrt(np.mean(error**2)):.0f}"
        f" | {1e6 * np.max(np.abs(error)):.0f} | {1e6 * np.median(stderr):.0f}"
        f" | {np.mean(np.abs(off) < 2.0):.0%} | {np.sqrt(np.mean(off**2)):.2f} |"
    )


def in_real_time(timer_ms: int | None, schedule: str, inserted: int, bursts: int, seed: int) -> str:
    """One line of the table: the driver in a process of its own, against the bus in another."""
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
        print(f"{adapter}: {device}", file=sys.stderr)
        return (
            f"| {adapter} | {1e3 * found.age_median:.2f} | {LAG * 1e3:.3f}"
            f" | {1e3 * device.value:.3f} ± {1e3 * device.stderr:.3f}"
            f" | {(device.value - LAG) / device.stderr:+.1f} | {inserted}"
            f" | {1e3 * recovered.value:.3f} ± {1e3 * recovered.stderr:.3f}"
            f" | {(recovered.value - inserted * config.period_s) / recovered.stderr:+.1f} |"
        )
    ended = f"{ATTEMPTS} runs ended early"
    return f"| {adapter} | - | {LAG * 1e3:.3f} | {ended} | - | {inserted} | - | - |"


def page(
    runs: int, memory_runs: int, bursts: int, adapters: Sequence[tuple[int | None, str]]
) -> list[str]:
    """The whole page."""
    lines = [
        "# How good the measured delay is",
        "",
        "Written by `scripts/delay_check`; run it to see the figures of your machine. What is"
        " compared is the lag of the [measurement](loop-delay.md) and that of the servo, which is"
        " known because the servo is simulated or emulated.",
        "",
        f"{measured_on()} {bursts} bursts of torque steps in each run.",
        "",
        "## On the simulated clock",
        "",
        f"Lags drawn from 0 to {1e3 * LONGEST:g} ms, 0 to 5 periods of 1 ms inserted, 4096 counts"
        " unless named otherwise. *Off*: the error over the standard error given with it, root of"
        " the mean square; 1 is what an honest standard error has.",
        "",
        "| servo | runs | mean error, µs | rms error, µs | largest, µs | stderr given (median), µs"
        " | within two | off |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, sets in SERVOS.items():
        lines.append(simulated(name, sets, runs, "simulated", bursts))
    lines.append(simulated("emulated bus, in memory", (), memory_runs, "emulated-xm430", bursts))
    lines += [
        "",
        "## In real time",
        "",
        "The serial driver against the emulated bus in a process of its own. *Off* is in standard"
        " errors. The lag is counted from the sending of the goal, so it holds what the goal frame"
        " takes longer on its way than the request.",
        "",
        "| adapter | age of a sample (median), ms | true lag, ms | measured, ms | off"
        " | periods inserted | recovered, ms | off |",
        "|---|---|---|---|---|---|---|---|",
        *[in_real_time(*adapter, 3, bursts, 10 * i) for i, adapter in enumerate(adapters)],
        "",
    ]
    return lines


def main() -> None:
    """Measure, write the page."""
    parser = page_options("delay_check", __doc__, "delay-check.md")
    parser.add_argument("--runs", type=int, default=60, help="of each simulated servo")
    parser.add_argument("--bursts", type=int, default=BURSTS, help="in each run")
    parser.add_argument("--quick", action="store_true", help="few runs, one adapter")
    wanted = parser.parse_args()
    runs = 4 if wanted.quick else wanted.runs
    adapters = ADAPTERS[:1] if wanted.quick else ADAPTERS
    lines = page(runs, math.ceil(runs / 4), wanted.bursts, adapters)
    wanted.out.write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
