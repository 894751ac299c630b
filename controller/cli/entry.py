"""The entry point of ``haptic-wall``: handles Ctrl-C quietly before anything is imported.

Importing a command's modules takes up to half a second, in which Python answers a Ctrl-C with a
traceback, or with an error of the library that is being imported.
"""

from __future__ import annotations

import os

from haptic_wall.controller.cli import interrupt


def main() -> int | str | None:
    """Import the program and run the command of this process; return its exit status."""
    interrupt.leave_at_once()
    # All matrices are small: several threads for one wait for each other, and take cores from the
    # loop. A start with a link takes several times as long with two on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from haptic_wall.controller.cli.main import main as run
    from haptic_wall.controller.system.signals import was_interrupted

    status: int | str | None
    try:
        status = run()
    except SystemExit as ended:
        status = ended.code
    finally:
        interrupt.leave_to_the_system()
    if was_interrupted() and isinstance(status, int):
        interrupt.end_without_python(status)
    return status
