"""The loops that are compared on an emulated bus: the whole program and the bare loop.

Both take turns on the one bus, on the same core and with the same scheduling; the emulated bus has
another core where there are two. Each loop decides how long before a deadline it stops sleeping:
the bare loop at a fixed fraction of the period, this program by a measurement at the start.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from haptic_wall.controller.bench.bare_loop import PERCENTILES
from haptic_wall.controller.emulated_bus.bus import PROGRAM
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.processes import emulator
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.processes.supervisor import Supervisor
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config

BAUD: Final = 4_000_000
START_S: Final = 20.0
"""Time allowed for a child to start, and to end [s]"""
_WARM_UP_S: Final = 0.05
FORGIVING: Final = (
    "realtime.profile=best-effort",
    "servo.watchdog_s=0.5",
    "safety.heartbeat_s=2",
    "safety.max_silence_s=0.25",
    "safety.max_loss=0.9",
)
"""Settings that keep the machine's own stalls from ending a run; they do not affect the measurement
"""
AT_REST: Final = ("wall.side=both", "wall.reference=start", "wall.position=0")
"""A two-sided wall at the position of an emulated servo: always in contact, and at rest"""


class Turn(NamedTuple):
    """One run of a loop."""

    skipped: int
    """Periods without a cycle"""
    work_us: dict[int, float]
    """Processor's work of a cycle, without its waits; by percentile [µs]"""


Loop = Callable[[str, float, float, int], Turn]
"""Runs on the bus at a path, for so long [s], at a rate [Hz], with so many servos"""


@contextmanager
def emulated_bus(**plan: object) -> Iterator[str]:
    """Start an emulated bus on the cores that a loop does not use; yield its terminal's path.

    Args:
        plan: Further fields of its ``Plan``.

    Raises:
        ServoError: It did not start.
    """
    arguments = [PROGRAM, json.dumps({"servos": ["XM430-W350:1"], "baud": BAUD, **plan})]
    with emulator.emulated_bus(arguments, pick_cores()[1]) as (_, path):
        assert path is not None
        yield path


def bare(path: str, seconds: float, rate_hz: float, servos: int) -> Turn:
    """Run the bare loop, for one servo or six.

    Raises:
        PlatformError: It did not end by itself.
    """
    options = ["--rate", str(rate_hz), "--servos", str(servos)]
    words = ["haptic_wall.controller.bench.bare_loop", path, str(seconds), *options]
    told = told_by("the bare loop", words, seconds, os.sched_getaffinity(0))
    return Turn(int(told["missed_ticks"]), {p: told[f"work_us_p{p}"] for p in PERCENTILES})


def told_by(name: str, words: Sequence[str], seconds: float, cores: set[int]) -> dict[str, Any]:
    """Run a loop (its module and arguments) for so long [s]; return the figures that it tells.

    Raises:
        PlatformError: It told nothing.
    """
    loop = Child(name, list(words), None, cores=cores)
    try:
        told = first_line(loop, seconds + START_S)
    finally:
        loop.dismiss(START_S)
    if told is None:
        raise PlatformError(f"{name} gave no result: it {loop.exit_text()}")
    figures: dict[str, Any] = json.loads(told)
    return figures


def ours(path: str, seconds: float, rate_hz: float, servos: int) -> Turn:
    """Run the whole program once: supervisor, loop with guard and detector, recorder.

    Its log is discarded. Several servos, with the ids from 1 on, are an axis each. A Ctrl-C ends it
    immediately: the handlers of ``haptic-wall run`` only ask the run to stop, and would lose one
    that comes when the loop has just ended. A run that a trip has ended, on a machine that is too
    slow, has skipped all remaining periods.

    Raises:
        ServoError: The servo could not be started.
    """
    sets = [f"servo.port={path}", f"loop.rate_hz={rate_hz!r}", f"loop.warm_up_s={_WARM_UP_S}"]
    if servos > 1:
        axes = ", ".join(f"a{id_}: {{servo: {{id: {id_}}}}}" for id_ in range(1, servos + 1))
        sets.append(f"axes={{{axes}}}")
    loaded = load_config("xm430-w350", (*FORGIVING, *AT_REST, *sets))
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(Telemetry.create(axes=servos)) as telemetry,
    ):
        log = Path(folder) / "run.hwlog"
        plan = Plan(loaded.config, seconds, log, {"name": loaded.name}, None)
        ended = Supervisor(plan, telemetry, lambda _text: None).run()
    skipped = max(ended.missed, round(seconds * rate_hz) - ended.ticks)
    work = ended.statistics.work
    return Turn(skipped, {p: work.percentile_us(p) or math.nan for p in PERCENTILES})


LOOPS: Final[dict[str, Loop]] = {"bare loop": bare, "haptic-wall": ours}
