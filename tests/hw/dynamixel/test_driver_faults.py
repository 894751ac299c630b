"""Each fault of bus and servo through the driver: what it costs, how it counts, how it is named.

On the emulated bus in memory: its faults are seeded and its time is simulated, so every run is the
same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import asdict, replace

import pytest

from haptic_wall.hw.dynamixel.registers import POSITION_UNIT
from haptic_wall.hw.errors import ServoHealthError, TorqueLostError
from haptic_wall.hw.servo import Outcome, Reading
from tests.cases import sampled
from tests.hw.dynamixel.bench import TRUE, Bench, pin

FREE = replace(TRUE, coulomb=0.0, damping=0.0)
SPEED = 5.0
"""Of the shaft in most tests [rad/s]: three counts a period"""
PERIOD_NS = 1_000_000
WATCHED_NS = 200_000_000
EVERYTHING_NS = 5 * WATCHED_NS
"""Within which what is watched is noticed"""


MIXTURE = """
drop:p=0.02,way=reply corrupt:flips=1,p=0.02,way=reply corrupt:flips=64,p=0.02,way=reply
truncate:p=0.02,way=reply late:ms=1.5,p=0.02,way=reply wrong-id:p=0.02,way=reply
"""
"""64 flipped bits are a third of a reply"""


def moving(**settings: object) -> Bench:
    """A started servo that has been brought to ``SPEED`` and is left alone."""
    bench = Bench(FREE, probe_torque=0.0, **settings)  # type: ignore[arg-type]
    bench.servo.start()
    while bench.state.velocity < SPEED:
        bench.cycle(1.0)
    return bench


def cycle(bench: Bench, torque: float = 0.0) -> Reading:
    begun = bench.clock.now_ns()
    bench.servo.request()
    reading = bench.servo.collect(begun + 800_000)
    bench.servo.write(torque)
    bench.clock.wait_until(begun + PERIOD_NS)
    return reading


def counts(bench: Bench) -> dict[str, int]:
    """What was counted, without what is zero and without the cycles."""
    return {k: v for k, v in asdict(bench.servo.counts).items() if v and k != "cycles"}


def fresh(bench: Bench) -> None:
    bench.servo.counts.cycles = 0
    for name in ("lost", "late", "corrupt"):
        setattr(bench.servo.counts, name, 0)


@pytest.mark.parametrize(
    ("fault", "kinds", "failed"),
    [
        *sampled(
            [
                ("drop:p=0.1,way=reply", {"lost"}, 0.1),
                ("drop:p=0.1,way=request", {"lost"}, 0.1),
                ("corrupt:p=0.1,way=reply", {"corrupt", "lost"}, 0.1),
                # The servo says: CRC error.
                ("corrupt:p=0.1,way=request", {"corrupt", "lost"}, 0.1),
                ("truncate:p=0.1,way=reply", {"corrupt", "lost"}, 0.1),  # nothing may be left
                ("duplicate:p=0.1,way=reply", {"late"}, 0.0),
                ("late:ms=1.5,p=0.1,way=reply", {"lost", "late"}, 0.1),
                ("late:ms=3,p=0.1,way=reply", {"lost", "late"}, 0.3),  # it keeps the wire meanwhile
                ("wrong-id:p=0.1,way=reply", {"lost"}, 0.1),
                ("noise:p=0.1,way=reply", set(), 0.0),
            ],
            5,
        ),
        (MIXTURE, {"corrupt", "lost", "late"}, 0.1),
    ],
)
def test_a_struck_reply_costs_no_more_than_the_periods_it_misses_and_is_counted_as_what_it_was(
    fault: str, kinds: set[str], failed: float
) -> None:
    bench = moving()
    fresh(bench)
    for one in fault.split():
        bench.bus.inject(one, bench.clock.now_ns())
    bad = 0
    for _ in range(1000):
        reading = cycle(bench)
        if reading.outcome is Outcome.OK:
            # What is read is where the shaft was when it was asked, to half a count and the time
            # that bytes take (0.1 ms).
            truth = bench.state
            since = (bench.clock.now_ns() - reading.sampled_ns) * 1e-9
            then = truth.position - truth.velocity * since
            assert abs(reading.position - then) < POSITION_UNIT + 2e-4 * SPEED
        else:
            assert math.isnan(reading.position)
            bad += 1
    found = bench.servo.counts
    assert found.cycles == 1000
    assert bad == found.lost + found.corrupt
    assert set(counts(bench)) <= kinds
    # Binomial: three times the deviation of 1000 draws at 0.1 is 28.
    assert bad == pytest.approx(1000 * failed, abs=30 * (1 + 10 * failed) if failed else 0)


# The servo's health


def until_it_ends(bench: Bench, torque: float = 0.2, seconds: float = 1.0) -> int:
    """Cycle until something is raised; how long that took [ns]."""
    begun = bench.clock.now_ns()
    try:
        for _ in range(round(seconds * 1000)):
            cycle(bench, torque)
    finally:
        bench.took_ns = bench.clock.now_ns() - begun  # type: ignore[attr-defined]
    return begun


def started(**settings: object) -> Bench:
    bench = Bench(TRUE, probe_torque=0.0, **settings)  # type: ignore[arg-type]
    bench.servo.start()
    for _ in range(10):
        cycle(bench)
    return bench


def torque_enable(bench: Bench) -> None:
    bench.truth.memory["torque_enable"] = 0


def watchdog_off(bench: Bench) -> None:
    bench.truth.memory["bus_watchdog"] = 0


@pytest.mark.parametrize("baud", [4_000_000, 2_000_000], ids=["4M", "2M"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (torque_enable, "torque of the .* is off, but this program has not switched it off"),
        (watchdog_off, "Bus Watchdog .* has another setting"),
    ],
)
def test_what_another_program_changes_is_noticed_and_named(
    baud: int, change: Callable[[Bench], None], message: str
) -> None:
    bench = started(baud=baud, bus_baud=baud)
    change(bench)
    with pytest.raises(TorqueLostError, match=message):
        until_it_ends(bench, seconds=1.1)
    # Each look comes at the first tick that finds it due, and so may be a tick later.
    assert bench.took_ns <= EVERYTHING_NS + 5 * PERIOD_NS  # type: ignore[attr-defined]
    assert bench.servo.stop() is True


@pytest.mark.parametrize(
    ("volts", "message"), [(80, r"supplied with 8 V, wanted 9\.5 to 16 V"), (170, "17 V")]
)
def test_a_supply_out_of_its_limits_ends_the_run(volts: int, message: str) -> None:
    bench = started()
    pin(bench.truth, "present_input_voltage", volts)
    with pytest.raises(ServoHealthError, match=message):
        until_it_ends(bench)
    assert bench.took_ns <= 2 * WATCHED_NS + PERIOD_NS  # type: ignore[attr-defined]


def test_a_dip_of_the_supply_is_nothing() -> None:
    bench = started()
    pin(bench.truth, "present_input_voltage", 80)
    until_it_ends(bench, seconds=0.19)
    pin(bench.truth, "present_input_voltage", 120)
    until_it_ends(bench)


def test_heat_ends_the_run_before_the_servo_does() -> None:
    bench = started()
    pin(bench.truth, "present_temperature", 78)
    until_it_ends(bench, seconds=0.5)
    pin(bench.truth, "present_temperature", 79)
    with pytest.raises(ServoHealthError, match="has 79 °C, wanted at most 78 °C"):
        until_it_ends(bench)


def test_a_servo_that_has_restarted_can_be_started_again_at_once() -> None:
    bench = started(watchdog_s=2.0)
    bench.bus.inject("brown-out", bench.clock.now_ns())
    with pytest.raises(TorqueLostError, match=r"Bus Watchdog|torque of"):
        until_it_ends(bench, seconds=3.0)
    bench.servo.stop()
    assert all(check.ok for check in bench.servo.start())


@pytest.mark.parametrize(
    ("bits", "message"),
    [
        ("overload", r"has latched: overload; free its shaft.*reboot it"),
        ("overheating+voltage", r"latched: input voltage, overheating; bring its supply .*cool"),
        ("encoder", "position may be wrong"),
        ("shock", "short circuit"),
    ],
)
def test_a_hardware_error_is_told_in_the_next_reading_and_named_after_the_stop(
    bits: str, message: str
) -> None:
    bench = started()
    bench.bus.inject(f"hardware-error:bits={bits}", bench.clock.now_ns())
    assert any(cycle(bench).alert for _ in range(2))
    assert bench.servo.stop() is True
    assert re.search(message, bench.servo.trouble)


# What it costs


ALL_OF_IT = "torque enable, bus watchdog, supply, temperature every 0.2 s"


@pytest.mark.parametrize(
    ("baud", "period_s", "watched"),
    [
        (4_000_000, 1e-3, ALL_OF_IT),
        (1_000_000, 1e-3, "bus watchdog, supply, temperature every 0.4 s"),
        (1_000_000, 2e-3, ALL_OF_IT),
        (57_600, 20e-3, "bus watchdog, supply, temperature every 0.4 s"),
        (57_600, 14e-3, "supply, temperature every 0.2 s"),
    ],
)
def test_what_is_watched_is_what_fits_and_is_said(baud: int, period_s: float, watched: str) -> None:
    bench = Bench(baud=baud, bus_baud=baud, period_s=period_s, watchdog_s=0.2)
    assert bench.found("watched while it runs") == watched
    for _ in range(100):
        begun = bench.clock.now_ns()
        bench.servo.request()
        reading = bench.servo.collect(begun + round(0.8e9 * period_s))
        assert reading.outcome is Outcome.OK
        bench.servo.write(0.0)
        bench.clock.wait_until(begun + round(period_s * 1e9))
