"""What a child process is told: one JSON object on its standard input."""

from __future__ import annotations

import json
import sys
from typing import Any


def read_orders() -> dict[str, Any]:
    """The orders of this process; where its parent was interrupted before it gave any, it ends."""
    line = sys.stdin.readline()
    if not line.endswith("\n"):
        sys.exit()
    orders: dict[str, Any] = json.loads(line)
    return orders
