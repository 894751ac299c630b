"""A Dynamixel bus without hardware for the tests of any program that talks to one.

A pytest plugin, found by itself once the distribution is installed: the fixture ``dynamixel_bus``
starts ``haptic-wall emulate`` in a process of its own. Nothing of that program is imported
here, so that it costs the tests no time and shares no interpreter with the program under test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from .bus import BusError, DynamixelBus
from .record import BusRow

__all__ = ["BusError", "BusRow", "DynamixelBus", "dynamixel_bus"]

_MARKER = (
    "dynamixel_bus(servos=['XM430-W350:1'], baud=4000000, latency_timer=0, block=None, faults=[], "
    "seed=0, truth={}): what the fixture dynamixel_bus emulates (haptic-wall)"
)


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def dynamixel_bus(request: pytest.FixtureRequest) -> Iterator[DynamixelBus]:
    """A fresh emulated Dynamixel bus, as the marker of the same name says; ends with the test.

    Raises:
        UsageError: The marker says what it cannot say.
        BusError: The bus does not start, or has died during the test.
    """
    options: dict[str, Any] = {}
    for marker in reversed([*request.node.iter_markers("dynamixel_bus")]):
        if marker.args:
            raise pytest.UsageError(
                f"dynamixel_bus: found {marker.args[0]!r} without a name, wanted {_MARKER}"
            )
        options |= marker.kwargs  # the nearer to the test, the stronger
    try:
        bus = DynamixelBus(**options)
    except TypeError as error:
        raise pytest.UsageError(f"dynamixel_bus: {error}; wanted {_MARKER}") from error
    with bus:
        yield bus
