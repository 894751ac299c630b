"""Times the stages of a tick by wrapping the methods of its parts, for the benchmark only.

The tick itself is unchanged and does not know of it. The cost of the timing is measured in the same
ticks, with a method that does nothing, and subtracted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.schedule import GainSchedule
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.passivity_control import PassivityControl
from haptic_wall.controller.laws.velocity import BackwardDifference
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.cache_warm_up import CacheWarmUp
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.runtime.tick import Tick
from haptic_wall.hw.servo import Servo

Method = Callable[..., Any]

WAKE, SENSE, WATCH, WALL, WRITE, GUARD, TELEMETRY, REST = STAGES = (
    "from waking to the tick's first line",
    "sensing: request, reply, velocity",
    "watching for oscillations",
    "wall and delay",
    "writing the torque",
    "guard",
    "telemetry row",
    "all between: safety, order, control words",
)
"""The stages in the order of a tick"""
_SERVO: Final[Mapping[str, str]] = {"request": SENSE, "write": WRITE}
_PARTS: Final[tuple[tuple[type, str, str], ...]] = (
    (BackwardDifference, "update", SENSE),
    (Watch, "passed", WATCH),
    (Watch, "sample", WATCH),
    (PassivityControl, "update", WATCH),
    (Wall, "torque", WALL),
    (DelayRing, "push", WALL),
    (GainSchedule, "observe", GUARD),
    (Telemetry, "write", TELEMETRY),
)


class Nothing:
    """Has a method that does nothing, timed like the others."""

    def work(self) -> None:
        """Do nothing."""


class StageTimes:
    """Measures the times of every tick's stages.

    Attributes:
        inside_ns: Time that the timing adds to a stage with each call, tick by tick [ns].
        around_ns: Further time of the timing, which belongs to no stage [ns].
    """

    def __init__(self) -> None:
        self._spent = dict.fromkeys(STAGES, 0)
        self._calls = dict.fromkeys(STAGES, 0)
        self._waited = 0
        self._ticks: list[tuple[int, ...]] = []
        self.inside_ns: list[int] = []
        self.around_ns: list[int] = []

    @contextmanager
    def listening(self, servo: type[Servo]) -> Iterator[None]:
        """Time the parts of every tick inside the block, parts that are made there included.

        Args:
            servo: Class of the servo that is used.
        """
        nothing = Nothing()
        with ExitStack() as stack:
            for name, stage in _SERVO.items():
                self._time(stack, servo, name, stage)
            stack.enter_context(patch.object(servo, "collect", self._waiting(servo.collect)))
            for part, name, stage in _PARTS:
                self._time(stack, part, name, stage)
            self._time(stack, Nothing, "work", REST)
            stack.enter_context(patch.object(Tick, "run", self._whole(Tick.run, nothing)))
            unheard = self._unheard(CacheWarmUp.__call__)
            stack.enter_context(patch.object(CacheWarmUp, "__call__", unheard))
            yield

    def _time(self, stack: ExitStack, part: type, name: str, stage: str) -> None:
        method: Method = getattr(part, name)
        now, spent, calls = time.monotonic_ns, self._spent, self._calls

        def timed(self: object, *values: object) -> object:
            began = now()
            found = method(self, *values)
            spent[stage] += now() - began
            calls[stage] += 1
            return found

        stack.enter_context(patch.object(part, name, timed))

    def _waiting(self, collect: Method) -> Method:
        """Wrap ``Servo.collect``; waiting for a bus is not the controller's work."""
        now, spent, calls = time.monotonic_ns, self._spent, self._calls

        def timed(servo: Servo, deadline_ns: int) -> object:
            began = now()
            found = collect(servo, deadline_ns)
            waited_ns = 0 if servo.bus is None else servo.bus.waited_ns
            spent[SENSE] += now() - began - waited_ns
            calls[SENSE] += 1
            self._waited += waited_ns
            return found

        return timed

    def _whole(self, run: Method, nothing: Nothing) -> Method:
        """Wrap ``Tick.run``: time it, and measure the cost of the timing."""
        now, spent, calls, ticks = time.monotonic_ns, self._spent, self._calls, self._ticks

        def timed(tick: Tick, deadline_ns: int, woke_ns: int, missed: int) -> None:
            begun = now()
            for stage in spent:  # discard work between the ticks
                spent[stage] = calls[stage] = 0
            self._waited = 0
            began = now()
            run(tick, deadline_ns, woke_ns, missed)
            work = now() - began - self._waited
            ticks.append((begun - woke_ns, work, *spent.values(), *calls.values()))
            spent[REST] = 0
            began = now()
            nothing.work()
            around = now() - began
            self.inside_ns.append(spent[REST])
            self.around_ns.append(around - spent[REST])

        return timed

    def _unheard(self, warm_up: Method) -> Method:
        """Wrap ``CacheWarmUp``, so that its dry-run ticks are not timed."""
        kept = self._ticks, self.inside_ns, self.around_ns

        def untimed(cache_warm_up: CacheWarmUp, left_ns: int) -> None:
            count = len(self._ticks)
            warm_up(cache_warm_up, left_ns)
            for each in kept:
                del each[count:]

        return untimed

    def times_us(self, from_tick: int) -> dict[str, NDArray[np.float64]]:
        """Return the time of each stage in each tick, without bus waits and the timing itself [µs].

        Args:
            from_tick: Number of ticks to omit at the beginning.

        Returns:
            By stage, each of shape (n,).
        """
        ticks = np.array(self._ticks[from_tick:], dtype=np.float64)
        count = len(STAGES)
        wake, work = ticks[:, :2].T
        spent, calls = ticks[:, 2 : 2 + count].T, ticks[:, 2 + count :].T
        inside = float(np.median(self.inside_ns[from_tick:]))
        around = float(np.median(self.around_ns[from_tick:]))
        found = dict(zip(STAGES, spent - calls * inside, strict=True))
        found[WAKE] = wake
        found[REST] = work - np.sum(spent, axis=0) - np.sum(calls, axis=0) * around
        return {stage: times * 1e-3 for stage, times in found.items()}
