"""Files that are there whole or not at all: written under another name, then put in place."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.signals import on_signals


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write in place of ``path``; it is moved there when all went well, else removed.

    SIGTERM and SIGHUP interrupt whoever writes, as Ctrl-C does.
    A device or a pipe (/dev/stdout, ``>(gzip)``) is written as it is.

    Raises:
        OSError: It cannot be put in place.
    """
    # First: a pipe has no name to resolve to, and others write to what /dev/stdout is, too.
    if path.exists() and (not path.is_file() or path.is_relative_to("/dev")):
        yield path
        return
    path = path.resolve()  # what a link points to is replaced, not the link
    part = path.with_name(f"{path.name}.part-{os.getpid()}")
    try:
        # A terminal that is closed and a machine that shuts down leave no half file either; what
        # nohup has had ignored stays so.
        ending = (signal.SIGTERM, signal.SIGHUP)
        heeded = [number for number in ending if signal.getsignal(number) != signal.SIG_IGN]
        with on_signals(signal.default_int_handler, heeded):
            yield part
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)
