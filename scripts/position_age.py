"""Measures how old the positions are that a program gets from a run on an emulated bus.

scripts/study position_age [CONFIG] [--rate HZ] [--seconds S]
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

import haptic_wall


def main() -> int:
    """Print the percentiles of the age and of the time of a call."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", nargs="?", default="emulated-arm")
    parser.add_argument("--rate", type=float, default=60.0, help="calls per second [Hz]")
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    with haptic_wall.run(given.config, {"loop.clock": "monotonic"}) as wall:
        axes = len(wall.positions(math.inf))
        ages, calls = [], []
        due_s = time.perf_counter()
        for _ in range(round(given.rate * given.seconds)):
            due_s += 1.0 / given.rate
            time.sleep(max(0.0, due_s - time.perf_counter()))
            begun_s = time.perf_counter()
            wall.positions(math.inf)
            calls.append(time.perf_counter() - begun_s)
            ages.append(wall.age_s)
        report = wall.report()
    print(
        f"{len(ages)} calls of {axes} axes at {given.rate:g} Hz; loop at {report['grid_hz']:g} Hz"
    )
    for name, times_s in (("age", ages), ("call", calls)):
        p50, p99, most = 1e3 * np.percentile(times_s, (50, 99, 100))
        print(f"{name:5} median {p50:.2f} ms, 99 % {p99:.2f} ms, longest {most:.2f} ms")
    return 0
