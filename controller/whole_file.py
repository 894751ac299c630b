"""Files that are there whole or not at all: written under another name, then put in place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.signals import interrupting


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write in place of ``path``; it is moved there when all went well, else removed.

    Ctrl-C, SIGTERM and SIGHUP interrupt whoever writes: a terminal that is closed and a machine
    that shuts down leave no half file. What is ignored, by nohup for instance, stays so.
    A device or a pipe (/dev/stdout, ``>(gzip)``) is written as it is.

    Raises:
        OSError: It cannot be put in place.
        KeyboardInterrupt: It was interrupted.
    """
    # First: a pipe has no name to resolve to, and others write to what /dev/stdout is, too.
    if path.exists() and (not path.is_file() or path.is_relative_to("/dev")):
        yield path
        return
    path = path.resolve()  # what a link points to is replaced, not the link
    part = path.with_name(f"{path.name}.part-{os.getpid()}")
    try:
        with interrupting():
            yield part
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)
