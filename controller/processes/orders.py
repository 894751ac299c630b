"""Reads the orders of a child process: one JSON object on its standard input."""

from __future__ import annotations

import json
import sys
from typing import Any


def read_orders() -> dict[str, Any]:
    """Return the orders of this process; exit if the parent ended before it sent any."""
    line = sys.stdin.readline()
    if not line.endswith("\n"):
        sys.exit()
    orders: dict[str, Any] = json.loads(line)
    return orders
