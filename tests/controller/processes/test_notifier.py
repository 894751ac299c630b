"""What is said is said in order, and nobody waits for a terminal that stands still."""

import os
import threading

from haptic_wall.controller.processes.run import Notifier


def test_a_terminal_that_stands_still_holds_nobody_up_and_loses_nothing() -> None:
    goes_on = threading.Event()
    heard = []

    def tell(text: str) -> None:
        assert goes_on.wait(30.0)
        heard.append(text)

    with Notifier(tell) as notifier:
        notifier("first")
        notifier("second")
        assert heard == [], "the call came back all the same"
        goes_on.set()
    assert heard == ["first", "second"]


def test_a_terminal_that_is_gone_is_no_reason_to_end() -> None:
    heard = []

    def tell(text: str) -> None:
        if text == "first":
            raise BrokenPipeError
        heard.append(text)

    with Notifier(tell) as notifier:
        notifier("first")
        notifier("second")
    assert heard == ["second"]


def test_who_speaks_keeps_off_the_core_that_the_speaker_has_left() -> None:
    cores = os.sched_getaffinity(0)
    others = {min(cores)}
    heard = []
    with Notifier(lambda _text: heard.append(os.sched_getaffinity(0))) as notifier:
        os.sched_setaffinity(0, others)
        try:
            notifier("first")
        finally:
            os.sched_setaffinity(0, cores)
    assert heard == [others]
