"""A line transfers uninterpreted bytes to and from a bus: its interface, and that of a port."""

from __future__ import annotations

import errno
import os
import select
import time
from typing import Final, Protocol

from haptic_wall.hw.clock import Clock, ready
from haptic_wall.hw.elastic import ElasticClock
from haptic_wall.hw.errors import WIRING, PortLostError

_SPIN_NS: Final = 60_000
"""Final part of a wait that is spun: a sleep this short returns late by its own length."""
_REPLY: Final = 256
"""Bytes read at once after a wait; a small buffer is taken from memory that is in use anyway"""
_EVERYTHING: Final = 4096
"""The same where nobody waits for the bytes: as many as a terminal's buffer holds"""
_WRITE_PATIENCE_S: Final = 0.02
"""A port whose output buffer stays full this long has stopped sending."""


class Line(Protocol):
    """One end of a half-duplex bus: a port, or memory.

    Where it is gone, each method raises ``ServoLostError``, and so does all that uses a line.
    """

    @property
    def clock(self) -> Clock:
        """Return the clock of its deadlines."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data`` in one piece (a gap of 1.5 ms inside a frame breaks it)."""
        ...

    def read(self) -> bytes:
        """Return the received bytes, without waiting; empty when there are none."""
        ...

    def wait(self, deadline_ns: int) -> bool:
        """Wait for bytes until ``deadline_ns`` [ns]; return whether there are any."""
        ...

    def close(self) -> None:
        """Close the line."""
        ...


class FdLine:
    """A line on the descriptor of a configured serial port or pseudo-terminal."""

    __slots__ = ("_arrived", "_descriptor", "_elastic", "_only", "_poll", "clock")

    def __init__(self, descriptor: int, clock: Clock) -> None:
        """Take over ``descriptor``; ``close`` closes it.

        Args:
            descriptor: An open port, as ``haptic_wall.hw.serialport.port.open_port`` returns it.
            clock: Clock of the deadlines; bytes arrive in real time, so a real one.
        """
        os.set_blocking(descriptor, False)
        self.clock = clock
        self._elastic = clock if isinstance(clock, ElasticClock) else None
        self._descriptor = descriptor
        self._only = (descriptor,)
        self._arrived = False
        """``wait`` has just seen bytes"""
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        self._poll = poll.poll

    def write(self, data: bytes) -> None:
        """Send all of ``data``, in one piece unless the output buffer is full.

        Raises:
            PortLostError: The port is gone, or has stopped sending.
        """
        if data and self._elastic is not None:
            self._elastic.sent(len(data))
        try:
            sent = os.write(self._descriptor, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise _lost(error) from error
        if sent < len(data):
            self._write_rest(data[sent:])

    def read(self) -> bytes:
        """Return the received bytes, without waiting.

        Raises:
            PortLostError: The port is gone.
        """
        most = _REPLY
        if self._arrived:
            self._arrived = False
        else:
            # Checking first takes a third of the time of the error for an empty buffer.
            if not self._poll(0) and self._descriptor >= 0:
                return b""
            most = _EVERYTHING
        try:
            data = os.read(self._descriptor, most)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _lost(error) from error
        if not data and self._hung_up():
            raise _lost(None)
        if self._elastic is not None:
            self._elastic.got(len(data))
        return data

    def wait(self, deadline_ns: int) -> bool:
        """Wait for bytes until ``deadline_ns`` [ns]; return whether there are any.

        It sleeps while the kernel can wake it in time and spins for the rest, so that it neither
        oversleeps the deadline nor keeps a core busy.

        Raises:
            PortLostError: The line was closed.
        """
        now_ns = self.clock.now_ns
        if self._elastic is not None:
            self._elastic.expect(deadline_ns)
        while True:
            remaining = deadline_ns - now_ns()
            pause = max(0, remaining - _SPIN_NS) * 1e-9
            try:
                if select.select(self._only, (), (), pause)[0]:
                    self._arrived = True
                    return True
            except (OSError, ValueError) as error:
                closed = OSError(errno.EBADF, os.strerror(errno.EBADF))
                raise _lost(closed) from error
            if remaining <= 0:
                return False

    def close(self) -> None:
        """Close the descriptor; the kernel then releases the lock. Safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
            self._only = (-1,)  # the number may soon belong to another file

    def _write_rest(self, data: bytes) -> None:
        end = time.monotonic() + _WRITE_PATIENCE_S
        while data:
            if not ready((), max(0.0, end - time.monotonic()), self._only):
                raise PortLostError(
                    f"The serial port has sent nothing for {_WRITE_PATIENCE_S * 1e3:.0f} ms "
                    "with a frame waiting",
                    advice=f"check {WIRING}.",
                )
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise _lost(error) from error

    def _hung_up(self) -> bool:
        """Whether an empty read means a hang-up (without VMIN it may mean an empty buffer)."""
        gone = select.POLLHUP | select.POLLERR | select.POLLNVAL
        return any(event & gone for _, event in self._poll(0))


def _lost(error: OSError | None) -> PortLostError:
    reason = error.strerror if error is not None else "it has hung up"
    return PortLostError(
        f"The serial port is gone ({reason})",
        advice=f"check {WIRING}, then start again.",
    )
