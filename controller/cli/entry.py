"""The entry point of ``haptic-wall``: ends on Ctrl-C in one line, even before all is imported.

Importing a command's modules takes up to half a second, in which Python answers a Ctrl-C with a
traceback, or with an error of the library that is being imported.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from haptic_wall.controller.cli import interrupt


def main() -> int | str | None:
    """Import the program and run the command of this process; return its exit status."""
    interrupt.leave_at_once()
    # All matrices are small: several threads for one wait for each other, and take cores from the
    # loop. A start with a link takes several times as long with two on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from haptic_wall.controller.cli.main import main as run

    status: int | str | None
    try:
        status = run()
    except SystemExit as ended:
        status = ended.code
    if status == interrupt.INTERRUPTED:
        # A library that a KeyboardInterrupt has passed through may abort in Python's shutdown.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # no reader; closed
                stream.flush()
        atexit._run_exitfuncs()
        os._exit(interrupt.INTERRUPTED)
    for number in (signal.SIGINT, signal.SIGTERM):  # a handler is not safe in that shutdown
        if signal.getsignal(number) is interrupt.leave:
            signal.signal(number, signal.SIG_DFL)
    return status
