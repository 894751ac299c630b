"""Measures the wake-up lateness at 1 kHz of this program, of loop-rate-limiters, and of cyclictest.

All wake up on the same core and take turns of a second, so that the machine's other work affects
them alike. The comparison with cyclictest uses measurements of the same round.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from haptic_wall.controller.bench import cyclictest
from haptic_wall.controller.bench.lateness_client import PERIOD_NS
from haptic_wall.controller.bench.loops import told_by
from haptic_wall.controller.bench.rows import Measurement, Section, over_rounds, ratio
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.processes.supervisor import Supervisor
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP, Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS, _TICKS = 8, 1000
_WARM_UP_S: Final = 0.1
_WARM_UP_TICKS: Final = round(1e9 * _WARM_UP_S / PERIOD_NS)
"""Not counted, for each loop but cyclictest, which has no warm-up"""
_PERCENTILES: Final = (50.0, 99.0, 99.9)
_PROGRAM: Final = "haptic-wall run"
_YARDSTICK: Final = "cyclictest"


@dataclass(frozen=True, slots=True)
class Turn:
    """Result of one client in one round."""

    late_us: FloatArray
    rate_hz: float | None
    """Achieved rate [Hz]; None: unknown"""
    settings: Sequence[Mapping[str, Any]] = ()
    """Real-time settings, wanted against granted; empty: none was requested"""


Client = Callable[[], Turn]


def measure() -> Section:
    """Measure percentiles of the lateness, and the achieved rate, of each client."""
    core, _ = pick_cores()
    clients, notes = _clients(core)
    seen: dict[str, list[Turn]] = {name: [] for name in clients}
    for _ in range(_ROUNDS):
        for name, client in clients.items():
            seen[name].append(client())
    rows = [row for name, each in seen.items() for row in _rows(name, each)]
    if _YARDSTICK in seen:
        rows += _compared(seen)
        words = " ".join(cyclictest.options(core, _TICKS))
        notes.append(f"cyclictest was run as: cyclictest {words}")
    notes.append(_granted(seen[_PROGRAM][-1].settings))
    return Section(tuple(rows), tuple(notes))


def _clients(core: int) -> tuple[dict[str, Client], list[str]]:
    """Return the available clients, and a sentence about each that is not."""
    notes = []
    clients: dict[str, Client] = {_PROGRAM: partial(_program, core)}
    if (path := cyclictest.installed()) is None:
        notes.append(
            "cyclictest is not installed, so nothing is compared with it: install rt-tests (on"
            " Debian and Ubuntu: apt-get install rt-tests)"
        )
    else:
        try:
            cyclictest.lateness_us(path, core, 10)
            clients[_YARDSTICK] = partial(_cyclictest, path, core)
        except PlatformError as error:
            notes.append(f"nothing is compared with cyclictest: {error}")
    try:
        name = f"loop-rate-limiters {version('loop-rate-limiters')}"
        clients[name] = partial(_limiter, core)
        notes.append(
            f"{name} counts each period from the previous wake-up, and so does its lateness here:"
            " the delivered rate shows the sum"
        )
    except PackageNotFoundError:
        notes.append(
            "loop-rate-limiters is not installed, so nothing is compared with it: pip install"
            " -e '.[bench]' in the clone adds it"
        )
    return clients, notes


def _percentile(turns: Sequence[Turn], q: float) -> list[float]:
    """Return the percentile of each round [µs]."""
    return [float(np.percentile(turn.late_us, q, method="inverted_cdf")) for turn in turns]


def _rows(name: str, turns: Sequence[Turn]) -> list[Measurement]:
    rows = [
        over_rounds(f"{name}, lateness, p{q:g}", _percentile(turns, q), "µs") for q in _PERCENTILES
    ]
    rates = [turn.rate_hz for turn in turns if turn.rate_hz is not None]
    if rates:
        what = f"{name}, rate delivered of {1e9 / PERIOD_NS:g} Hz asked"
        rows.append(over_rounds(what, rates, "Hz"))
    return rows


def _compared(seen: Mapping[str, Sequence[Turn]]) -> list[Measurement]:
    """Return our p99 over cyclictest's of the same round."""
    # It reports whole µs, rounded down: 0 only means below 1.
    theirs = [max(p99, 1.0) for p99 in _percentile(seen[_YARDSTICK], 99.0)]
    return [
        ratio(
            f"{_PROGRAM}: p99 of lateness over cyclictest's",
            _percentile(seen[_PROGRAM], 99.0),
            theirs,
        )
    ]


def _granted(settings: Sequence[Mapping[str, Any]]) -> str:
    got = ", ".join(f"{setting['name']}: {setting['found']}" for setting in settings)
    return f"{_PROGRAM} requested real-time settings and got: {got}"


def _cyclictest(path: str, core: int) -> Turn:
    with _elsewhere(core):
        return Turn(cyclictest.lateness_us(path, core, _TICKS).astype(np.float64), None)


def _limiter(core: int) -> Turn:
    """Run a round of the rate limiter.

    Raises:
        PlatformError: It reported nothing.
    """
    ticks = _WARM_UP_TICKS + _TICKS
    words = ["haptic_wall.controller.bench.lateness_client", str(ticks), str(os.getpid())]
    with _elsewhere(core):
        seconds = 2e-9 * PERIOD_NS * ticks
        told = told_by("the rate limiter", words, seconds, {core})
    late = 1e-3 * np.array(told["lateness_ns"][_WARM_UP_TICKS:], dtype=np.float64)
    return Turn(late, _rate(ticks, told["elapsed_ns"]))


def _program(core: int) -> Turn:
    """Run a round of the whole program, on a servo simulated in its loop.

    Raises:
        PlatformError: The run ended too early.
    """
    sets = ("realtime.profile=best-effort", f"realtime.core={core}", f"loop.warm_up_s={_WARM_UP_S}")
    loaded = load_config("simulated", sets)
    with tempfile.TemporaryDirectory() as folder, closing(Telemetry.create()) as telemetry:
        seconds = 1e-9 * PERIOD_NS * _TICKS
        plan = Plan(loaded.config, seconds, Path(folder) / "log", {"name": loaded.name}, None)
        # Without a command's signal handlers: a Ctrl-C ends the whole benchmark.
        ended = Supervisor(plan, telemetry, lambda _text: None).run()
        rows, _ = telemetry.read(0)
    if ended.stop_reason != "duration":
        raise PlatformError(f"a run of the simulated servo ended by itself: {ended.stop_reason}")
    rows = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
    woken = rows["deadline_ns"] + rows["lateness_ns"]
    rate_hz = _rate(rows.size, int(woken[-1] - woken[0]))
    return Turn(1e-3 * rows["lateness_ns"].astype(np.float64), rate_hz, ended.realtime)


def _rate(ticks: int, elapsed_ns: int) -> float:
    """Return the rate of the wake-ups, the first and the last counted [Hz]."""
    return 1e9 * (ticks - 1) / elapsed_ns


@contextmanager
def _elsewhere(core: int) -> Iterator[None]:
    """Keep this process off a core, where there is another one."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores - {core} or cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
