"""Runs the emulated bus in real time, behind a pseudo-terminal for serial clients.

It is one process with one thread. The thread sleeps until the next event of the bus, byte of the
client or line on the console. It spins shortly before a reply must leave, and writes the record in
between.
"""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Self

from haptic_wall.hw.clock import ready
from haptic_wall.hw.elastic import BusClock
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.console import Console
from haptic_wall.hw.emulated.witness import Witness
from haptic_wall.hw.serialport.port import baud_of

_SPIN_NS = 60_000
"""Sleeping ends this long before a reply is due [ns]: waking up takes about as long"""
_NAP_NS = 10_000_000
"""Longest sleep [ns]; a stop request is noticed after it"""
_HELD_NS = 200_000
"""Shortest sleep while the time stands still [ns]"""
_IDLE_NS = 300_000
"""Part of the record is written if no event is due for this long [ns]"""
_ROWS_AT_ONCE = 4
"""Rows of the record written in one idle window: about 15 µs, by which a request may be delayed"""
_MAX_WAITING = 200_000
"""Rows kept in memory; with more they are written at once"""
_FLUSH_NS = 500_000_000
"""Period of flushing the record to the operating system [ns]"""
_READ_SIZE = 4096


class PseudoTerminal(AbstractContextManager["PseudoTerminal"]):
    """Both ends of a raw pseudo-terminal; clients may open and close ``path`` at any time.

    Args:
        link: Path of a symbolic link to it; an existing link is replaced.

    Raises:
        FileExistsError: A file that is no symbolic link is at ``link``.
        OSError: The link cannot be made.
    """

    def __init__(self, link: Path | None = None) -> None:
        self._wanted_link = link
        self._link: Path | None = None
        self._ends: tuple[int, ...] = ()
        self._untouched_speed: int | None = None
        self.replug()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __enter__(self) -> Self:
        return self

    @property
    def connected(self) -> bool:
        """Whether the terminal exists, so that clients can open it."""
        return bool(self._ends)

    @property
    def baud(self) -> int | None:
        """Return the baud rate that a client has set [bit/s]; None: unset or unknown."""
        speed = baud_of(self.master)
        if speed is None or speed == self._untouched_speed:
            return None
        self._untouched_speed = None
        return speed

    def close(self) -> None:
        """Close both ends; remove the link if it still points here."""
        if self._link is not None:
            with suppress(OSError):
                if str(self._link.readlink()) == self.path:
                    self._link.unlink()
            self._link = None
        for end in self._ends:
            with suppress(OSError):
                os.close(end)
        self._ends = ()

    def replug(self) -> None:
        """Open a new terminal after ``close``, perhaps at another path.

        Raises:
            OSError: There are no more terminals, or the link cannot be made.
        """
        self.master, slave = self._ends = os.openpty()
        try:
            # Kept open: otherwise the client's close would hang up the line.
            tty.setraw(slave)
            os.set_blocking(self.master, False)
            self.path = os.ttyname(slave)
            if self._wanted_link is not None:
                self._make(self._wanted_link)
        except BaseException:
            self.close()
            raise
        self._untouched_speed = baud_of(self.master)

    def _make(self, link: Path) -> None:
        if os.path.lexists(link) and not link.is_symlink():
            raise FileExistsError(f"{link} exists and is not a symbolic link")
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(self.path)
        try:
            fresh.replace(link)
        except OSError:
            fresh.unlink()
            raise
        self._link = link


def serve(
    bus: EmulatedBus,
    terminal: PseudoTerminal,
    stopped: Callable[[], bool],
    witness: Witness | None = None,
    console: Console | None = None,
    announce: Callable[[str], None] | None = None,
    elastic: BusClock | None = None,
) -> None:
    """Run ``bus`` on the monotonic clock until ``stopped`` returns true, checked every 10 ms.

    Args:
        bus: The bus, started on the monotonic clock.
        terminal: The client's end of the line.
        stopped: Called between events.
        witness: Witness of the bus; its rows are written here.
        console: Changes the bus while it runs.
        announce: Called with the terminal's path when an unplugged adapter is back.
        elastic: The time that the bus shares with its loop; None: it is for any client.
    """
    clock = time.monotonic_ns if elastic is None else elastic.now_ns
    taken = given = 0
    baud = bus.host_baud
    flush_ns = clock() + _FLUSH_NS
    while not stopped():
        now_ns = clock()
        reply = bus.transmit(now_ns)
        if bus.connected != terminal.connected:
            _follow(bus, terminal, announce)
        if reply:
            with suppress(BlockingIOError):  # a client that does not read loses bytes, as on a wire
                given += os.write(terminal.master, reply)
        if not bus.busy:
            for servo in bus.servos:
                servo.keep_up(now_ns)
        event_ns = bus.next_event_ns()
        if elastic is not None:
            elastic.report(taken, given, event_ns if bus.busy else None)
        rest_ns = _NAP_NS if event_ns is None else min(event_ns - clock(), _NAP_NS)
        if witness is not None and (rest_ns > _IDLE_NS or witness.waiting > _MAX_WAITING):
            witness.write(_ROWS_AT_ONCE)
            if now_ns > flush_ns:
                witness.flush()
                flush_ns = now_ns + _FLUSH_NS
            rest_ns = _NAP_NS if event_ns is None else min(event_ns - clock(), _NAP_NS)
        held = elastic is not None and elastic.held
        least_ns = _HELD_NS if held and rest_ns > 0 else 0
        if bus.busy:
            rest_ns -= _SPIN_NS
        master = () if bus.full or not terminal.connected else (terminal.master,)
        told = () if console is None else console.listens(now_ns)
        news = ready(master + told, max(rest_ns, least_ns) * 1e-9)
        if not news:
            continue
        now_ns = clock()
        if master and terminal.master in news:
            data = os.read(terminal.master, _READ_SIZE)
            bus.host_baud = terminal.baud or baud
            bus.receive(data, now_ns)
            taken += len(data)
        if console is not None and told and told[0] in news:
            console.read(now_ns)


def _follow(
    bus: EmulatedBus, terminal: PseudoTerminal, announce: Callable[[str], None] | None
) -> None:
    """Unplug or plug in the terminal together with the adapter."""
    if not bus.connected:
        terminal.close()
        return
    terminal.replug()
    if announce is not None:
        announce(terminal.path)
