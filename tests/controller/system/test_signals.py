"""Which signals ask a run to stop."""

import os
import signal
import threading
from collections.abc import Callable

import pytest

from haptic_wall.controller.system.signals import STOPPING, interrupting, on_signals
from tests.support.program import python

SAYS = (
    "from haptic_wall.controller.system.signals import STOPPING;"
    "print(*(each.name for each in STOPPING))"
)


def begun(ignores: bool) -> list[str]:
    """What a program heeds that begins with the terminal's end ignored, as by nohup, or not."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignores else signal.SIG_DFL)
    try:
        return python("-c", SAYS).stdout.split()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_closed_terminal_ends_a_run_but_not_one_that_nohup_began() -> None:
    assert begun(ignores=False) == ["SIGINT", "SIGTERM", "SIGHUP"]
    assert begun(ignores=True) == ["SIGINT", "SIGTERM"]


def send(number: int = signal.SIGTERM) -> None:
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("number", STOPPING)
def test_who_puts_something_in_order_is_interrupted_by_each_of_them(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), interrupting():
        send(number)
    assert signal.getsignal(number) == before


def swallowed() -> None:
    try:
        send()
    except KeyboardInterrupt:
        return


def made_another_error() -> None:
    try:
        send()
    except KeyboardInterrupt:
        raise ImportError("initialization failed") from None


@pytest.mark.parametrize("library", [swallowed, made_another_error])
def test_an_interruption_is_not_lost_in_a_library(library: Callable[[], None]) -> None:
    with pytest.raises(KeyboardInterrupt), interrupting():
        library()


def test_another_error_stays_what_it_is() -> None:
    with pytest.raises(ImportError), interrupting():
        raise ImportError("not there")


def test_what_is_ignored_stays_ignored() -> None:
    done = []
    with on_signals(signal.SIG_IGN), interrupting():
        send()
        done.append("all")
    assert done == ["all"]


def test_beside_the_main_thread_nothing_is_changed() -> None:
    before, during = signal.getsignal(signal.SIGTERM), []

    def work() -> None:
        with interrupting():
            during.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert during == [before]
