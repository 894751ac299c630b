"""The loop's own process: reads its orders on standard input, reports on standard output.

Orders are one JSON object; reports are one JSON object a line, each with an ``event``. The process
runs nothing else: a busy thread beside the loop would cost it stalls of 5 ms.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import asdict
from functools import partial

from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.processes.hold import key_reader
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.runtime.machine_setup import machine_setup, start_text
from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_result import defect_text
from haptic_wall.controller.runtime.session_start import Surroundings
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.config import RUNS, Config
from haptic_wall.controller.system.orders import read_orders, say
from haptic_wall.hw.clock import Clock, MonotonicClock
from haptic_wall.hw.elastic import PLACE, WORDS, ElasticClock
from haptic_wall.hw.errors import Problem, ServoError
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.open import open_bus

LAST_S = 5
"""Longest life of this process after a signal told it to end [s]. The kernel then ends it; the
torque goes off by the servo's Bus Watchdog only."""


def main() -> None:
    """Run one session as ordered; at its end the torque is off, or the control words deny it."""
    orders = read_orders()
    config = Config.model_validate_json(orders["config"], context=RUNS)
    telemetry = Telemetry(orders["telemetry"], axes=len(config.each))

    def stop(_signal: int, _frame: object) -> None:
        telemetry.words[Word.STOP] = 1
        signal.alarm(LAST_S)  # the supervisor, which would end a hung loop by force, may be dead

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    # The parent blocked these signals until this process had a group of its own and handlers.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGHUP})
    realtime.die_with_parent(orders["parent"], signal.SIGTERM)
    os.sched_setaffinity(0, {orders["core"]})
    clock: Clock = MonotonicClock()
    if orders["elastic"]:
        clock = ElasticClock(telemetry.words[PLACE : PLACE + WORDS], config.period_ns)
    try:
        hand = None if orders["hand"] is None else SharedHand(orders["hand"])
        result = run_session(
            config,
            clock,
            telemetry,
            orders["duration_s"],
            [Phase(**phase) for phase in orders["program"]],
            Surroundings(
                port=orders["port"],
                tell=lambda text: _tell("tell", text=text),
                take_real_time=lambda: _prepare(config, orders["core"]),
                open_bus=partial(open_bus, hand=hand),
                read_key=orders["key"] and _key_reader(orders["key"], telemetry.words),
            ),
        )
    except (ServoError, PlatformError) as error:
        problem = error.problem
    except Exception as error:  # noqa: BLE001 - whatever it was, it must be said
        # The session has tried to switch the torque off; the supervisor checks whether that was
        # read back. Report the error.
        advice = "this is a defect of haptic-wall, please report it"
        problem = Problem(defect_text(error), advice=advice, mark=": ")
    else:
        _tell("ended", result=asdict(result))
        return
    _tell("refused", problem=asdict(problem))


def _key_reader(key: tuple[int, str], words: memoryview[int]) -> Callable[[int], float]:
    """Return what reads the dead man's key; the supervisor is told if its device is gone.

    Args:
        key: Descriptor and path of the device.
        words: The control words.
    """
    descriptor, path = key

    def gone(error: OSError) -> None:
        _tell("key_gone", why=f"{path} is gone ({error.strerror or error})")

    return key_reader(descriptor, words, gone)


def _prepare(config: Config, core: int) -> None:
    """Apply the real-time settings, and report the granted ones.

    Raises:
        PlatformError: The profile is strict, and a setting it needs was not granted.
    """
    wishes = config.realtime
    settings = realtime.apply(wishes.profile, realtime.LOOP_PRIORITY, {core})
    _tell("realtime", settings=[asdict(setting) for setting in settings])
    _tell("tell", text=start_text(settings, machine_setup(core)))
    missing = realtime.missing_for_strict(settings)
    if missing and wishes.profile == "strict":
        lacking = "; ".join(f"{s.name}: wanted {s.wanted}, {s.found}; {s.fix}" for s in missing)
        problem = Problem(
            field="realtime.profile",
            given=f"is strict, but the system did not grant all settings ({lacking})",
            advice="or run with --set realtime.profile=best-effort to use the granted ones",
        )
        raise PlatformError(problem)


def _tell(event: str, **content: object) -> None:
    say({"event": event, **content})  # torque off does not depend on it


if __name__ == "__main__":
    main()
