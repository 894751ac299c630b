"""Runs a command that ends with its starter: SIGTERM as soon as its standard input closes."""

from __future__ import annotations

import os
import signal
import sys
import threading

from haptic_wall.controller.cli.main import main


def _end_with_starter(descriptor: int) -> None:
    while os.read(descriptor, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    starter = os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    threading.Thread(target=_end_with_starter, args=(starter,), daemon=True).start()
    sys.exit(main())
