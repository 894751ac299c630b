"""Measures the wake-up lateness at 1 kHz of this program, of common loops, and of cyclictest.

All wake up on the same core and take turns of a second, so that the machine's other work affects
them alike. The comparison with cyclictest uses measurements of the same round.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from haptic_wall.controller.bench import cyclictest
from haptic_wall.controller.bench.lateness_client import PERIOD_NS, Orders
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
_WAIT: Final = "haptic-wall's wait alone"
_WAIT_ONLY: Final = "haptic-wall's wait alone, no real-time settings"
_YARDSTICK: Final = "cyclictest"
_SHOWS_NOT: Final = {
    _PROGRAM: "a servo on a bus: this one is simulated in the loop's process; nor its processor"
    " time",
    _WAIT: "a working loop: this one computes nothing between two wake-ups",
    _YARDSTICK: "a working loop; figures are whole µs, rounded down, from the first wake-up on"
    " (those of the others begin after a tenth of a second)",
}
_SHOWS_NOT_PEOPLE: Final = "the figure with real-time settings, or on a busy machine"


@dataclass(frozen=True, slots=True)
class Turn:
    """Result of one client in one round."""

    late_us: FloatArray
    rate_hz: float | None
    """Achieved rate [Hz]; None: unknown"""
    busy: float | None = None
    """Processor time as a fraction of the elapsed time; None: unknown"""
    settings: Sequence[Mapping[str, Any]] = ()
    """Real-time settings, wanted against granted; empty: none was requested"""


Client = Callable[[], Turn]


@dataclass(slots=True)
class _Seen:
    """The rounds of one client."""

    turns: list[Turn] = field(default_factory=list)

    def percentile(self, q: float) -> list[float]:
        """Return the percentile of each round [µs]."""
        late = [np.percentile(turn.late_us, q, method="inverted_cdf") for turn in self.turns]
        return [float(each) for each in late]


def measure() -> Section:
    """Measure percentiles of the lateness, and the achieved rate, of each client."""
    core, _ = pick_cores()
    clients, notes = _clients(core)
    seen = {name: _Seen() for name in clients}
    for _ in range(_ROUNDS):
        for name, client in clients.items():
            seen[name].turns.append(client())
    rows = [row for name, each in seen.items() for row in _rows(name, each)]
    if _YARDSTICK in seen:
        rows += _compared(seen)
        words = " ".join(cyclictest.options(core, _TICKS))
        notes.append(f"cyclictest was run as: cyclictest {words}")
    notes.append(_granted(seen[_WAIT].turns[-1].settings))
    notes.append(
        "a relative sleep and the rate limiter count each period from the previous wake-up, and so"
        " does their lateness here: the delivered rate shows the sum"
    )
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
    clients[_WAIT] = partial(_child, "settings", core)
    clients[_WAIT_ONLY] = partial(_child, "no settings", core)
    clients["time.sleep to the next deadline"] = partial(_child, "deadline", core)
    clients["time.sleep(period)"] = partial(_child, "relative", core)
    try:
        name = f"loop-rate-limiters {version('loop-rate-limiters')}"
        clients[name] = partial(_child, "limiter", core)
    except PackageNotFoundError:
        notes.append(
            "loop-rate-limiters is not installed, so nothing is compared with it: pip install"
            " -e '.[bench]' in the clone adds it"
        )
    return clients, notes


def _rows(name: str, seen: _Seen) -> list[Measurement]:
    shows_not = _SHOWS_NOT.get(name, _SHOWS_NOT_PEOPLE)
    rows = [
        over_rounds(f"{name}, lateness, p{q:g}", seen.percentile(q), "µs", shows_not)
        for q in _PERCENTILES
    ]
    rates = [turn.rate_hz for turn in seen.turns if turn.rate_hz is not None]
    if rates:
        what = f"{name}, rate delivered of {1e9 / PERIOD_NS:g} Hz asked"
        rows.append(over_rounds(what, rates, "Hz", shows_not))
    busy = [100.0 * turn.busy for turn in seen.turns if turn.busy is not None]
    if busy:
        rows.append(over_rounds(f"{name}, processor time", busy, "%", shows_not))
    return rows


def _compared(seen: Mapping[str, _Seen]) -> list[Measurement]:
    """Return our p99 over cyclictest's of the same round."""
    # It reports whole µs, rounded down: 0 only means below 1.
    theirs = [max(p99, 1.0) for p99 in seen[_YARDSTICK].percentile(99.0)]
    return [
        ratio(
            f"{name}: p99 of lateness over cyclictest's",
            seen[name].percentile(99.0),
            theirs,
            "the longest stalls, which are too rare in a second; cyclictest only sleeps, which"
            " takes less processor time than sleep and spin",
        )
        for name in (_PROGRAM, _WAIT)
    ]


def _granted(settings: Sequence[Mapping[str, Any]]) -> str:
    got = ", ".join(f"{setting['name']}: {setting['found']}" for setting in settings)
    return f"{_PROGRAM} and its wait requested real-time settings and got: {got}"


def _cyclictest(path: str, core: int) -> Turn:
    with _elsewhere(core):
        return Turn(cyclictest.lateness_us(path, core, _TICKS).astype(np.float64), None)


def _child(client: str, core: int) -> Turn:
    """Run a round of one of the loops of ``lateness_client``.

    Raises:
        PlatformError: It reported nothing.
    """
    ticks = _WARM_UP_TICKS + _TICKS
    orders = Orders(client, core, cyclictest.PRIORITY, ticks, os.getpid())
    module = "haptic_wall.controller.bench.lateness_client"
    with _elsewhere(core):
        seconds = 2e-9 * PERIOD_NS * ticks
        told = told_by(f"the loop '{client}'", [module], asdict(orders), seconds, {core})
    late = 1e-3 * np.array(told["lateness_ns"][_WARM_UP_TICKS:], dtype=np.float64)
    elapsed_ns = told["elapsed_ns"]
    busy = told["busy_ns"] / elapsed_ns
    return Turn(late, _rate(ticks, elapsed_ns), busy, told["settings"])


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
    return Turn(1e-3 * rows["lateness_ns"].astype(np.float64), rate_hz)


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
