"""Finds the real-time settings that this machine grants; a child process requests them."""

from __future__ import annotations

import json
import os
import signal
import sys
from dataclasses import asdict
from typing import Any

from haptic_wall.controller.bench import cyclictest
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.system.orders import read_orders

_PATIENCE_S = 20.0


def granted() -> list[dict[str, Any]]:
    """Return wanted against granted, a mapping each (see ``realtime.Setting``); empty: unknown."""
    if sys.platform != "linux":
        return []
    child = Child("the question for rights", [__name__], {"parent": os.getpid()})
    try:
        told = first_line(child, _PATIENCE_S)
    finally:
        child.dismiss(_PATIENCE_S)
    settings: list[dict[str, Any]] = json.loads(told) if told else []
    return settings


def main() -> None:
    """Request the settings, and print the result."""
    realtime.die_with_parent(read_orders()["parent"], signal.SIGTERM)
    core, _ = realtime.pick_cores()
    settings = realtime.apply("best-effort", cyclictest.PRIORITY, {core})
    sys.stdout.write(json.dumps([asdict(setting) for setting in settings]) + "\n")


if __name__ == "__main__":
    main()
