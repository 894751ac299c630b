"""The entry point of ``haptic-wall``: handles Ctrl-C quietly before anything is imported.

Importing a command's modules takes up to half a second, in which Python answers a Ctrl-C with a
traceback, or with an error of the library that is being imported.
"""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress

from haptic_wall.controller.cli import interrupt


def main() -> None:
    """Import the program, run the command of this process, and end with its exit status."""
    interrupt.leave_at_once()
    # All matrices are small: several threads for one wait for each other, and take cores from the
    # loop. A start with a link takes several times as long with two on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from haptic_wall.controller.cli.main import main as run

    try:
        status = run()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 0
    # Without Python's shutdown, in which a handler is not safe, and a library may abort that a
    # KeyboardInterrupt has passed through.
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # no reader; closed
            stream.flush()
    atexit._run_exitfuncs()
    os._exit(status)
