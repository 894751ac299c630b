"""``haptic-wall demo``: a lesson in the browser, with two simulated servos."""

from __future__ import annotations

import signal
import socket
from types import FrameType

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import answer, place_option
from haptic_wall.controller.live.place import live_at
from haptic_wall.controller.system.signals import on_signals


@click.command()
@place_option
def command(place: str) -> int:
    """Show in a browser why a stiff wall oscillates, and how the guard prevents it.

    The address is the first line on standard output; Ctrl-C ends the demo. The page has two
    simulated servos, one with the guard and one without. A mouse or a finger drags each of them. No
    hardware is needed.
    """
    from haptic_wall.controller.cli.demo_walls import demo, serve

    live = live_at(place, control=True, field="--at")
    signals: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        signals.append(number)

    def over() -> bool:
        return bool(signals)

    with socket.socket(fileno=live.descriptor), on_signals(stop), demo(live, over) as running:
        if not over():
            answer(live.address)
        serve(running, over)
    return interrupt.INTERRUPTED if signal.SIGINT in signals[:1] else 0
