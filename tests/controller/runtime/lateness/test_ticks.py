"""Late ticks are noticed, the worst kept, and those that were provoked called by their name."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from haptic_wall.controller.runtime import tick
from haptic_wall.controller.runtime.lateness.causes import Cause, Machine
from haptic_wall.controller.runtime.lateness.thread_counters import CounterReader, Counters
from haptic_wall.controller.runtime.lateness.ticks import WORST, LateTicks
from haptic_wall.controller.runtime.session import Surroundings, run_session
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.errors import TorqueLostError
from tests.cases import sampled
from tests.typed import not_none

PERIOD = 1_000_000
MS = 1_000_000
PLAIN = Machine(virtual=False, real_time=True, shared=False, knows_run_delay=True)


class Readings:
    """Counters that a test sets; the loop is on the core for a tenth of the time."""

    knows_run_delay = True

    def __init__(self) -> None:
        self.now = 0
        self.delay = 0
        self.reads = 0

    def read(self) -> Counters:
        self.reads += 1
        return Counters(self.now, self.now // 10, self.delay, 0, 0, self.now // PERIOD, 0)

    def steal_ns(self) -> None:
        return None

    def close(self) -> None:
        pass


def slept_until(instant_ns: int) -> SimpleNamespace:
    return SimpleNamespace(margin_ns=0, slept_ns=instant_ns)


@pytest.fixture
def readings() -> Readings:
    return Readings()


@pytest.fixture
def ticks(readings: Readings) -> Iterator[LateTicks]:
    """Without the collections that happen by themselves: they would be a cause."""
    gc.disable()
    try:
        with LateTicks(PLAIN, cast(CounterReader, readings), PERIOD) as late:
            late.begin(0)
            yield late
    finally:
        gc.enable()


def serve(
    ticks: LateTicks, readings: Readings, deadline: int, overdue: int, delay: int = 0, **more: Any
) -> None:
    """A tick that woke ``overdue`` late, of which it waited ``delay`` for the core."""
    woke = deadline + overdue
    facts: dict[str, Any] = {
        "waiter": slept_until(woke),
        "bus_ns": 0,
        "replies_lost": 0,
        "missed": 0,
    } | more
    readings.now = woke + 20_000 + facts["bus_ns"]
    readings.delay += delay
    ticks.late(deadline, woke, readings.now, **facts)


def test_the_worst_are_kept_and_all_are_counted(ticks: LateTicks, readings: Readings) -> None:
    for k in range(1, 31):
        serve(ticks, readings, 100 * k * PERIOD, k * MS, delay=k * MS, missed=k - 1)
    report = ticks.report()
    assert report["late_ticks"] == 30
    assert report["causes"] == {Cause.OTHER: 30}
    assert [tick["lateness_us"] for tick in report["worst"]] == [
        1000.0 * k for k in range(30, 30 - WORST, -1)
    ]
    worst = report["worst"][0]
    assert (worst["time_s"], worst["missed"], worst["work_us"]) == (3.0, 29, 20.0)


def test_the_longest_recent_stall_is_known(ticks: LateTicks, readings: Readings) -> None:
    serve(ticks, readings, 100 * MS, 4 * MS)
    assert ticks.stalled_s(readings.now) == 0.0, "a late tick is no stall"
    serve(ticks, readings, 200 * MS, 22 * MS)
    serve(ticks, readings, 300 * MS, 6 * MS)
    assert ticks.stalled_s(readings.now) == pytest.approx(0.022, abs=1e-4)
    assert ticks.stalled_s(readings.now + 600 * MS) == 0.0
    serve(ticks, readings, 900 * MS, 8 * MS)
    assert ticks.stalled_s(readings.now) == pytest.approx(0.008, abs=1e-4)


def test_a_wait_for_the_bus_is_late_only_when_it_is_long(
    ticks: LateTicks, readings: Readings
) -> None:
    def wait(deadline: int, bus: int, lost: int) -> None:
        ended = deadline + bus + 20_000
        readings.now = ended
        ticks.late(deadline, deadline, ended, slept_until(deadline), bus, lost, 0)

    wait(10 * PERIOD, 700_000, 0)
    assert ticks.report()["late_ticks"] == 0
    wait(20 * PERIOD, 900_000, 0)
    wait(30 * PERIOD, 810_000, 1)
    wait(40 * PERIOD, 1_900_000, 1)
    assert ticks.report()["causes"] == {Cause.LOST: 1, Cause.BUS: 2}


def test_what_is_usual_is_no_cause(ticks: LateTicks, readings: Readings) -> None:
    """Waiting 30 µs in each tick for the core adds up between two readings."""
    for k in range(1, 50):
        readings.now = 20 * k * PERIOD
        readings.delay = 20 * k * 30_000
        ticks.rest(20 * k * PERIOD, slept_until(20 * k * PERIOD), PERIOD, 0)
    serve(ticks, readings, 995 * PERIOD, 700_000, delay=15 * 30_000)
    assert ticks.report()["causes"] == {Cause.WOKEN_LATE: 1}


class Stall:
    """A simulated clock that stands still for nobody: the given tick takes 7 ms longer."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        clock: SimulatedClock,
        at: int,
        error: Exception | None = None,
    ) -> None:
        from haptic_wall.controller.runtime import tick

        plain, seen = tick.Tick._follow_guard, []

        def stalling(*args: Any, **kwargs: Any) -> Any:
            seen.append(0)
            if len(seen) == at:
                clock.wait_until(clock.now_ns() + 7 * MS)
                if error is not None:
                    raise error
            return plain(*args, **kwargs)

        monkeypatch.setattr(tick.Tick, "_follow_guard", stalling)


@pytest.mark.parametrize("error", sampled([TorqueLostError("the watchdog came first"), None], 2))
def test_a_run_tells_when_and_how_long(
    error: TorqueLostError | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tick that ends a run is explained like any other: its delay may be why it ended."""
    clock = SimulatedClock()
    Stall(monkeypatch, clock, 700, error)
    config = load_config("emulated-ideal", ["loop.clock=simulated"]).config
    with LateTicks(PLAIN, cast(CounterReader, Readings()), config.period_ns) as late:
        result = run_session(
            config,
            clock,
            Telemetry.create(),
            2.0,
            surroundings=Surroundings(take_real_time=lambda: late),
        )
    assert result.stop_reason == ("duration" if error is None else "trip:torque_lost")
    (worst,) = not_none(result.timing)["worst"]
    assert worst["time_s"] == pytest.approx(0.699)
    assert worst["work_us"] == pytest.approx(7000.0)
    assert worst["missed"] == (6 if error is None else 0)


@pytest.mark.parametrize("waited", [False, True])
def test_what_an_elastic_clock_takes_out_is_reported_all_the_same(
    waited: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one tick, as its own work or as a wait for the bus; and 3 ms before the tick after it."""
    clock, telemetry = SimulatedClock(), Telemetry.create()
    words, ended, plain = telemetry.words, tick.Tick._end, tick.Tick._follow_guard

    def stalling(*args: Any, **kwargs: Any) -> Any:
        if words[Word.HEAD] == 699:
            words[Word.OFFSET_NS] += 7 * MS
            words[Word.WAITED_NS] += 7 * MS * waited
        return plain(*args, **kwargs)

    def ending(*args: Any) -> None:
        ended(*args)
        words[Word.OFFSET_NS] += 3 * MS * (words[Word.HEAD] == 700)

    monkeypatch.setattr(tick.Tick, "_follow_guard", stalling)
    monkeypatch.setattr(tick.Tick, "_end", ending)
    config = load_config("emulated-ideal", ["loop.clock=simulated"]).config
    with LateTicks(PLAIN, cast(CounterReader, Readings()), config.period_ns) as late:
        surroundings = Surroundings(take_real_time=lambda: late)
        result = run_session(config, clock, telemetry, 0.5, surroundings=surroundings)
    rows, _ = telemetry.read(0)
    time_ns = {name: int(rows[700][name]) for name in ("work_ns", "bus_ns", "lateness_ns")}
    usual_ns = int(rows[690]["bus_ns"])
    assert time_ns["work_ns"] == 7 * MS * (not waited)
    assert time_ns["bus_ns"] == usual_ns + 7 * MS * waited
    assert time_ns["lateness_ns"] == 3 * MS
    assert (rows["lateness_ns"] > 0).sum() == 1
    assert result.missed == 0
    assert not_none(result.timing)["worst"][0]["time_s"] == pytest.approx(0.699)


@pytest.mark.whole
@pytest.mark.realtime
def test_a_run_that_was_stopped_and_continued_says_so(tmp_path: Path) -> None:
    """The whole program: the loop's process is stopped for longer than a period, and resumed."""
    words = ["run", "simulated", "--duration=60", "--json", "--log=run.hwlog", "--no-plot"]
    words += ["--set=safety.heartbeat_s=5", "--set=loop.warm_up_s=0.5"]
    command = [sys.executable, "-m", "haptic_wall.controller.cli.main", *words]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        loop = loop_of(run.pid)
        told = list(iter(not_none(run.stderr).readline, "simulated servo: torque is on\n"))
        time.sleep(0.8)  # past the warm-up: a stop in it is no tick of the wall
        os.kill(loop, signal.SIGSTOP)
        time.sleep(0.05)
        os.kill(loop, signal.SIGCONT)
        time.sleep(0.05)  # a tick or more
        run.send_signal(signal.SIGINT)
        output, _ = run.communicate(timeout=60)
    assert any("of 5 granted" in line for line in told), "wanted against got, at the start"
    timing = json.loads(output)["timing"]
    assert timing["stops"] == 1
    assert Cause.STOPPED in {tick["cause"] for tick in timing["worst"]}


def loop_of(pid: int) -> int:
    """The process of the loop that a run has started."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        for child in children:
            with suppress(OSError):
                if (
                    "haptic_wall.controller.processes.loop_process"
                    in Path(f"/proc/{child}/cmdline").read_text()
                ):
                    return int(child)
        time.sleep(0.02)
    raise AssertionError("the loop's process did not start")
