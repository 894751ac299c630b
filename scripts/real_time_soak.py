"""The whole program in real time through damaged replies, judged by the emulated bus's record."""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.whole_program import PROGRAM, emulated_bus, with_sets

WALL = ("wall.side=both", f"wall.position={pi}", "wall.stiffness=2", "wall.damping=0")
"""Around the place where the emulated servo stands; its hand moves it"""


@dataclass(frozen=True, slots=True)
class Soaked:
    """Report and record of one run."""

    report: dict[str, Any]
    struck: Counter[str]
    """How often each fault struck"""
    rate_hz: float
    """Rate of its reads, by the median of their intervals"""
    furthest: float
    """Largest distance of a position from the truth at its instant [rad]"""


def real_time_soak(seconds: float, seed: int, damage: Sequence[str], folder: Path) -> Soaked:
    """Run for so long on a pseudo-terminal; the damage begins when torque is on."""
    record, log = folder / "witness.csv", folder / "run.hwlog"
    with emulated_bus("--record", record, "--seed", str(seed), "--set", "servo.hand=push") as bus:
        run = subprocess.Popen(
            [
                *[*PROGRAM, "run", "xm430-w350", "--json", f"--duration={seconds}"],
                *with_sets((f"servo.port={bus.port}", *FORGIVING, *WALL)),
                *["--log", str(log), "--plot", str(folder / "run.png")],
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert run.stderr is not None
        said = ""
        for line in run.stderr:
            said += line
            if "torque is on" in line:
                bus.inject(*damage)
                break
        output, rest = run.communicate()
    if run.returncode:
        sys.exit(f"the run in real time ended with {run.returncode}: {output}{said}{rest}")
    truth = read_rows(record)
    states = [row for row in truth if row.event == "state"]
    reads = [
        row.time_s for row in truth if row.event == "rx" and row.instruction == Instruction.READ
    ]
    _, rows = read_log(log)
    position: FloatArray = rows["position"]
    known = np.isfinite(position)
    sampled: FloatArray = rows["sampled_ns"][known] * 1e-9
    true = np.interp(
        sampled,
        [row.time_s for row in states],
        [row.position_rad for row in states],
    )
    last = np.array(reads)[-round(seconds * 900) :]
    return Soaked(
        json.loads(output),
        Counter(row.fault for row in truth if row.event == "fault"),
        1.0 / float(np.median(np.diff(last))),
        float(np.abs(position[known] - true).max()),
    )
