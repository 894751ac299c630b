"""Lines of text that change a running bus: a fault's SPEC, ``off NAME``, or ``list``."""

from __future__ import annotations

import os
from collections.abc import Callable

from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.faults import KINDS
from haptic_wall.hw.emulated.values import suggestion

_READ_SIZE = 4096
_LEFT_ALONE_NS = 500_000_000
"""How often a terminal is asked whether it is ours [ns]"""


class Console:
    """Where lines come in.

    Args:
        bus: What they change.
        descriptor: Read from as lines come; its end is no matter.
        say: Told what was done.
        complain: Told what cannot be done.
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
        """The descriptor to wait for, if any."""
        if self._descriptor is None or now_ns < self._ours_from_ns:
            return ()
        return (self._descriptor,)

    def read(self, now_ns: int) -> None:
        """Take in what has come, and do what it says."""
        descriptor = self._descriptor
        if descriptor is None:
            return
        if not _is_ours(descriptor):
            # What is typed is for the shell that put us in the background, which reading would
            # stop us for.
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
        """Do what one line says."""
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
            raise ValueError(f"no fault is called {name!r}{suggestion(name, KINDS)}")
        done = self._bus.lift(name, now_ns)
        self._say(f"off {name}" if done else f"off {name} (there was none)")


def _is_ours(descriptor: int) -> bool:
    """Whether lines there are meant for this process: no terminal, or one it is in front at."""
    try:
        return not os.isatty(descriptor) or os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return True
