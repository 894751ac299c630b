"""Where the command ``haptic-wall`` begins: a Ctrl-C is quiet from here on, before anything loads.

Loading what a command needs takes up to half a second, in which Python answers a Ctrl-C with a
traceback, or with whatever the library that is just loading makes of it.
"""

from __future__ import annotations

from controller.cli import interrupt


def main() -> int:
    """Load the program and run the command of this process; its exit status."""
    interrupt.leave_at_once()
    from controller.cli.main import main as run

    try:
        return run()
    finally:
        interrupt.leave_to_the_system()
