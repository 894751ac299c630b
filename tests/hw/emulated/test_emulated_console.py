"""Lines that change the bus while it runs, through a real pipe."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from haptic_wall.hw.emulated.console import Console
from tests.hw.dynamixel.emulated_client import MS, Client


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


def test_a_terminal_is_left_alone_while_somebody_else_is_in_front_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Reading there would stop the whole bus (SIGTTIN)."""
    client = Client()
    master, slave = os.openpty()
    try:
        monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp() + 1)
        lines = Console(client.bus, slave, lambda _: None, lambda _: None)
        os.write(master, b"drop\n")
        lines.read(0)
        assert client.bus.faults == []
        assert lines.listens(100 * MS) == ()
        monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp())
        assert lines.listens(1_000 * MS) == (slave,)
        lines.read(1_000 * MS)
        assert [text for text, _ in client.bus.faults] == ["drop"]
    finally:
        os.close(master)
        os.close(slave)
