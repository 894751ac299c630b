"""Runs a loop that executes a part of a tick: the child process of ``scripts/study compiled_tick``.

It reads one JSON object of orders on standard input, and writes one of figures. The loop waits as
the bare loop does. Each level executes what the one before does, and more, with the program's own
parts; the first one executes what the bare loop does.
"""

from __future__ import annotations

import gc
import math
import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import serial

from haptic_wall.controller.bench.bare_loop import (
    BAUD,
    GOAL_CURRENT_0,
    PATIENCE_SHARE,
    READ_16_AT_120,
    REPLY_BYTES,
    RETURN_DELAY_0,
    SPIN_SHARE,
)
from haptic_wall.controller.bench.loops import AT_REST, FORGIVING
from haptic_wall.controller.processes.orders import read_orders, say
from haptic_wall.controller.runtime.assembly import (
    guard_schedule,
    most_injected,
    rendered,
    tick_parts,
)
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.runtime.telemetry import Row, Telemetry
from haptic_wall.controller.runtime.tick import Tick, TickParts
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.serial_line import FdLine
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.servo import Outcome, Servo
from scripts.bus_calls import Calls

PERIOD_NS = 1_000_000
PATIENCE_NS = round(PATIENCE_SHARE * PERIOD_NS)
UNCOUNTED = 200
"""Ticks at the beginning that are not counted"""

Step = Callable[[int, int], int]
"""One tick, from its deadline and the time of waking [ns]; returns its bus wait [ns]"""


class Level(IntEnum):
    """Levels of the loop, each with the parts of the ones before."""

    BYTES = 0
    """The bare loop: one request, any 27 bytes, one goal"""
    MATCHED = 1
    """Replies matched to their requests, with checksum, length and the servo's clock"""
    DRIVER = 2
    """Watchdog, health, refused jumps; units of the servo"""
    VELOCITY = 3
    """Velocity, age and interval of the samples"""
    WALL = 4
    """Safety limits, the wall's torque, inserted delay"""
    GUARD = 5
    """Stiffness and damping by the gain schedule"""
    DETECTOR = 6
    """Oscillation watch and driven speed"""
    ROW = 7
    """A row in shared memory"""
    TICK = 8
    """The program's tick: start and stop of the wall, dead man, changes, trips, counters"""


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders to this process."""

    path: str
    """Path of the emulated bus"""
    level: int
    seconds: float
    calls: bool
    """Time each system call"""


def main() -> None:
    """Run as ordered, and write the figures."""
    orders = Orders(**read_orders())
    calls = Calls()
    with ExitStack() as stack:
        if orders.calls:
            stack.enter_context(calls.listening(__name__))
        step = stack.enter_context(opened(orders.path, Level(orders.level)))
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))
        os.sched_setaffinity(0, {pick_cores()[0]})
        gc.collect()
        gc.disable()
        served(step, UNCOUNTED * PERIOD_NS)
        calls.times_ns.clear()
        work_ns = served(step, round(orders.seconds * 1e9))
        gc.enable()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    p50, p99 = np.percentile(work_ns, [50, 99]).tolist()
    say({"p50": p50 * 1e-3, "p99": p99 * 1e-3, "calls": calls.figures(len(work_ns))})


def served(step: Step, duration_ns: int) -> list[int]:
    """Execute ticks as the bare loop does, for so long [ns]; return the work of each [ns]."""
    now = time.monotonic_ns
    spin_ns = round(SPIN_SHARE * PERIOD_NS)
    work = []
    deadline = now() + PERIOD_NS
    end = deadline + duration_ns
    while deadline < end:
        sleep = deadline - spin_ns - now()
        if sleep > 0:
            time.sleep(sleep * 1e-9)
        while (woke := now()) < deadline:
            pass
        waited = step(deadline, woke)
        done = now()
        work.append(done - woke - waited)
        deadline += (max(0, (done - deadline) // PERIOD_NS - 1) + 1) * PERIOD_NS
    return work


@contextmanager
def opened(path: str, level: Level) -> Iterator[Step]:
    """Open the bus; yield the tick of a level."""
    if level <= Level.MATCHED:
        with serial.Serial(path, BAUD, timeout=0, exclusive=True) as port:
            port.write(RETURN_DELAY_0)
            time.sleep(0.1)
            port.reset_input_buffer()
            descriptor = port.fileno()
            yield bytes_step(descriptor) if level is Level.BYTES else matched_step(descriptor)
        return
    config = load_config("xm430-w350", (*FORGIVING, *AT_REST, f"servo.port={path}")).config
    clock = MonotonicClock()
    servo = open_servo(config.servo_settings(), clock, None)
    try:
        schedule = guard_schedule(config, servo, simulated=False)
        injected = most_injected(config, servo, schedule)
        servo.start()
        law = rendered(config, clock, servo, ())
        telemetry = Telemetry.create(mapped=True)
        parts = tick_parts(
            config, clock, servo, telemetry, schedule, law, injected, engage_at_once=True
        )
        if level is Level.TICK:
            yield whole_step(Tick(parts), servo)
        elif level is Level.DRIVER:
            yield driver_step(servo)
        else:
            yield parts_step(parts, level)
        servo.stop()
    finally:
        servo.close()


def bytes_step(descriptor: int) -> Step:
    """Return the tick of the bare loop; reading the reply counts as work here."""
    now = time.monotonic_ns

    def step(_deadline_ns: int, woke_ns: int) -> int:
        if select.select([descriptor], [], [], 0)[0]:
            os.read(descriptor, 4096)
        os.write(descriptor, READ_16_AT_120)
        reply, waited = b"", 0
        while len(reply) < REPLY_BYTES and (left := woke_ns + PATIENCE_NS - now()) > 0:
            began = now()
            come = select.select([descriptor], [], [], left * 1e-9)[0]
            waited += now() - began
            if come:
                reply += os.read(descriptor, 4096)
        os.write(descriptor, GOAL_CURRENT_0)
        return waited

    return step


def matched_step(descriptor: int) -> Step:
    """Return a tick with the program's link to a servo whose torque is off."""
    link = Link(FdLine(os.dup(descriptor), MonotonicClock()), 1, baud=BAUD)

    def step(_deadline_ns: int, woke_ns: int) -> int:
        link.request()
        link.collect(woke_ns + PATIENCE_NS)
        link.send_current(0)
        return link.waited_ns

    return step


def driver_step(servo: Servo) -> Step:
    """Return a tick with the driver alone."""
    bus = servo.bus
    assert bus is not None

    def step(_deadline_ns: int, woke_ns: int) -> int:
        servo.request()
        servo.collect(woke_ns + PATIENCE_NS)
        servo.write(0.0)
        return bus.waited_ns

    return step


def parts_step(parts: TickParts, level: Level) -> Step:
    """Return a tick with some of the program's parts, up to a level."""
    servo, sampler, law, motion = parts.servo, parts.sampler, parts.law, parts.motion
    gains, safety, row, bus, now = parts.gains, parts.safety, Row(), servo.bus, parts.clock.now_ns
    wall, guard = level >= Level.WALL, level >= Level.GUARD
    detector, rows = level >= Level.DETECTOR, level >= Level.ROW
    assert bus is not None
    gains.begin()

    def step(deadline_ns: int, woke_ns: int) -> int:
        reading = sampler.sample(woke_ns)
        position, sampled_ns = sampler.position, sampler.sampled_ns
        wall_torque = torque = 0.0
        contact = False
        if wall and sampled_ns is not None:
            if sampler.outcome is Outcome.OK:
                safety.good(reading)
            if sampler.first:
                law.position += position
            contact = law.in_contact(position)
            if detector:
                motion.update(sampler, contact, 1)
            wall_torque = law.torque(position, sampler.damped)
            torque = parts.ring.push(wall_torque, 1)
            if not math.isfinite(torque):
                raise ValueError(f"a torque of {torque} N·m at {position} rad")
        sent_ns = now()
        sent = servo.write(torque)
        interval_ns = sampler.interval_ns(woke_ns)
        age_ns = 0 if sampled_ns is None else sent_ns - sampled_ns
        if detector:
            motion.watch.sent(sent)
        if guard:
            gains.follow(age_ns, interval_ns, not contact)
        if rows:
            row.deadline_ns, row.lateness_ns = deadline_ns, woke_ns - deadline_ns
            row.bus_ns, row.sampled_ns, row.age_ns = bus.waited_ns, sampled_ns or 0, age_ns
            row.outcome, row.position, row.velocity = sampler.outcome, position, sampler.velocity
            row.wall_torque, row.torque = wall_torque, sent
            row.stiffness, row.damping = law.stiffness, law.damping
            row.measured_torque, row.held_torque = sampler.measured_torque, law.held
            parts.telemetry.write(row)
        return bus.waited_ns

    return step


def whole_step(tick: Tick, servo: Servo) -> Step:
    """Return the program's tick, with the wall on."""
    bus = servo.bus
    assert bus is not None
    tick.wall_on()

    def step(deadline_ns: int, woke_ns: int) -> int:
        tick.run(deadline_ns, woke_ns, 0)
        if tick.trip is not None:
            raise RuntimeError(f"the tick tripped: {tick.trip}")
        return bus.waited_ns

    return step


if __name__ == "__main__":
    main()
