"""What is said is said in order, and nobody waits for a terminal that stands still."""

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
