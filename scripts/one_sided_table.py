"""Computes controller/theory/one_sided_table.npz, on all cores.

    scripts/study one_sided_table              overwrite the table in use
    scripts/study one_sided_table --out FILE   write it elsewhere
    scripts/study one_sided_table --check      the figures of docs/concepts/one-sided.md: the one in
                                               use against what is computed

It takes a quarter of an hour of processor time, and says how far it is; a check takes one minute.
The result is the same every time.
"""

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

# one thread per process: the processes take all cores
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import numpy as np

from haptic_wall.controller.theory import max_virtual_damping
from haptic_wall.controller.theory.one_sided_table import (
    MAX_DELTA,
    MAX_OF_CEILING,
    TABLE,
    tabulated_share,
)
from tests.support.one_sided_fill import computed_share, parts

CHECKED = 20_000
DELAYS = ((0.0, 1.0), (1.0, 5.0), (5.0, 60.0))
DAMPINGS = ((0.0, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, MAX_OF_CEILING))


def check() -> None:
    """How much of it is in the table, and how what is looked up compares with what is computed.

    The settings are random: a third in each range of the delay, evenly within it, and so the
    share of the ceiling; b T/m is spread evenly, or over its powers of ten from 1e-6.
    """
    random = np.random.default_rng(41)
    spread = 10 ** random.uniform(-6, np.log10(MAX_DELTA), CHECKED)
    delta = np.where(random.random(CHECKED) < 0.5, spread, MAX_DELTA * random.random(CHECKED))
    ends = np.array(DELAYS)[random.integers(0, len(DELAYS), CHECKED)].T
    delay = random.uniform(*ends)
    of_ceiling = MAX_OF_CEILING * random.random(CHECKED)
    ceiling = max_virtual_damping(1.0, delta, 1.0, delay)
    beta = of_ceiling * ceiling
    share = tabulated_share(delta, beta, delay, np.ones(CHECKED), ceiling)
    known = np.isfinite(share)
    for low, high in DAMPINGS:
        some = (of_ceiling >= low) & (of_ceiling < high)
        found = [known[some & (delay >= a) & (delay < b)].mean() for a, b in DELAYS]
        print(f"B from {low:g} to {high:g} of the ceiling:", *(f"{each:.1%}" for each in found))
    ratio = share[known] / computed_share(delta[known], beta[known], delay[known], 1)
    below = 1 - np.quantile(ratio, [0.5, 0.05, 0.0])
    print(
        f"{known.sum()} settings, looked up below what is computed: {below[0]:.1%} in the middle,"
        f" {below[1]:.1%} in one of twenty, {below[2]:.1%} at worst; above by at most"
        f" {max(ratio.max() - 1, 0):.2%}"
    )


def main() -> None:
    """Fill, and write; or check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=TABLE, metavar="FILE")
    parser.add_argument("--check", action="store_true", help="print the present table's accuracy")
    wanted = parser.parse_args()
    if wanted.check:
        check()
        return
    out = wanted.out
    started = time.monotonic()
    stored: dict[str, Any] = {}
    with ProcessPoolExecutor() as executor:
        for name, arrays in parts(executor):
            stored |= arrays
            print(f"{time.monotonic() - started:6.0f} s  {name}", file=sys.stderr, flush=True)
    np.savez_compressed(out, **stored)
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
