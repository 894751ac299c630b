"""Where the command ``haptic-wall`` begins: a Ctrl-C is quiet from here on, before anything loads.

Loading what a command needs takes up to half a second, in which Python answers a Ctrl-C with a
traceback, or with whatever the library that is just loading makes of it.
"""

from __future__ import annotations

from haptic_wall.controller.cli import interrupt


def main() -> int | str | None:
    """Load the program and run the command of this process; its exit status."""
    interrupt.leave_at_once()
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
