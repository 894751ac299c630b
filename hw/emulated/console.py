"""Executes lines of text that change a running bus: a fault's SPEC, ``off NAME``, or ``list``."""

from __future__ import annotations

import os
from collections.abc import Callable

from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.faults import KINDS, suggestion
from haptic_wall.hw.errors import SpecError

_READ_SIZE = 4096
_LEFT_ALONE_NS = 500_000_000
"""Period of the check whether this process is in the terminal's foreground [ns]"""


class Console:
    """Reads and executes lines.

    Args:
        bus: The bus to change.
        descriptor: Source of the lines; its end has no effect.
        say: Called with results.
        complain: Called with errors.
    """

    def __init__(
        self,
        bus: EmulatedBus,
        descriptor: int,
        say: Callable[[str], None],
        complain: Callable[[str], None],
    ) -> None:
        self._bus = bus
        self._descriptor: int | None = descriptor
        self._say = say
        self._complain = complain
        self._line = b""
        self._ours_from_ns = 0

    def listens(self, now_ns: int) -> tuple[int, ...]:
        """Return the descriptor to wait for, if any."""
        if self._descriptor is None or now_ns < self._ours_from_ns:
            return ()
        return (self._descriptor,)

    def read(self, now_ns: int) -> None:
        """Read the waiting lines and execute them."""
        descriptor = self._descriptor
        if descriptor is None:
            return
        if not _is_ours(descriptor):
            # In the background the typed text belongs to the shell, and reading would stop this
            # process.
            self._ours_from_ns = now_ns + _LEFT_ALONE_NS
            return
        try:
            data = os.read(descriptor, _READ_SIZE)
        except OSError:
            data = b""
        if not data:
            self._descriptor = None
        *lines, self._line = (self._line + data).split(b"\n")
        if not data and self._line:
            lines.append(self._line)
        for line in lines:
            self.obey(line.decode(errors="replace").strip(), now_ns)

    def obey(self, line: str, now_ns: int) -> None:
        """Execute one line."""
        verb, _, name = line.partition(" ")
        try:
            if verb == "list" and not name:
                found = [f"{text} (happened: {done})" for text, done in self._bus.faults]
                self._say("\n".join(found or ["no faults"]))
            elif verb == "off":
                self._lift(name.strip(), now_ns)
            elif line:
                self._bus.inject(line, now_ns)
                self._say(f"on {line}")
        except ValueError as error:
            self._complain(str(error))

    def _lift(self, name: str, now_ns: int) -> None:
        if name not in KINDS:
            raise SpecError(f"no fault is called {name!r}", advice=suggestion(name, KINDS))
        done = self._bus.lift(name, now_ns)
        self._say(f"off {name}" if done else f"off {name} (there was none)")


def _is_ours(descriptor: int) -> bool:
    """Whether this process may read there: no terminal, or in its foreground."""
    try:
        return not os.isatty(descriptor) or os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return True
