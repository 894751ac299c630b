"""Exchanges messages between the supervisor and a child: one JSON object in a line."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Any


def read_orders() -> dict[str, Any]:
    """Return the orders of this process; exit if the parent ended before it sent any."""
    line = sys.stdin.readline()
    if not line.endswith("\n"):
        sys.exit()
    orders: dict[str, Any] = json.loads(line)
    return orders


def say(what: Mapping[str, Any]) -> None:
    """Tell the supervisor; nothing happens where it is gone."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), (json.dumps(what) + "\n").encode())
