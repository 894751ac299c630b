"""Lines that change the bus while it runs, through a real pipe."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from haptic_wall.hw.emulated.console import Console
from tests.hw.dynamixel.emulated_client import Client


@contextmanager
def console(client: Client) -> Iterator[tuple[Console, int, list[str], list[str]]]:
    """The console, what writes to it, and what it has said and complained of."""
    there, here = os.pipe()
    said: list[str] = []
    complained: list[str] = []
    try:
        yield Console(client.bus, there, said.append, complained.append), here, said, complained
    finally:
        os.close(there)
        os.close(here)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"drp\n", ["'drp'", "did you mean drop?"]),
        (b"off drp\n", ["'drp'", "did you mean drop?"]),
        (b"off\n", ["''", "known are drop"]),
        (b"drop:p=7\n", ["drop: p", "'7'"]),
        (b"stuck:id=9\n", ["has the id 9"]),
        (b"\xff\xfe\n", ["known are"]),
    ],
)
def test_a_wrong_line_changes_nothing(line: bytes, words: list[str]) -> None:
    client = Client()
    with console(client) as (lines, here, said, complained):
        os.write(here, line)
        lines.read(client.clock.now_ns())
    assert said == []
    assert client.bus.faults == []
    assert len(complained) == 1
    assert all(word in complained[0] for word in words)


def test_the_end_of_the_lines_is_not_the_end_of_the_bus() -> None:
    client = Client()
    there, here = os.pipe()
    lines = Console(client.bus, there, lambda _: None, lambda _: None)
    os.write(here, b"drop")  # without a newline
    os.close(here)
    lines.read(0)
    lines.read(0)
    os.close(there)
    assert lines.listens(0) == ()
    assert [text for text, _ in client.bus.faults] == ["drop"]
