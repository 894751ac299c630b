"""Provides an emulated Dynamixel bus for the tests of any program that uses one.

It is a pytest plugin, active once the distribution is installed: the fixture ``dynamixel_bus``
starts ``haptic-wall emulate`` in a process of its own. It imports nothing of that program, so that
it costs the tests no time and shares no interpreter with the program under test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from haptic_wall.controller.emulated_bus.bus import BusError, DynamixelBus
from haptic_wall.controller.emulated_bus.record import BusRow

__all__ = ["BusError", "BusRow", "DynamixelBus", "dynamixel_bus"]

_MARKER = (
    "dynamixel_bus(servos=['XM430-W350:1'], baud=4000000, latency_timer=0, block=None, faults=[], "
    "seed=0, truth={}): settings of the fixture dynamixel_bus (haptic-wall)"
)


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def dynamixel_bus(request: pytest.FixtureRequest) -> Iterator[DynamixelBus]:
    """Yield a fresh emulated Dynamixel bus with the options of the marker of the same name.

    Raises:
        UsageError: The marker has invalid options.
        BusError: The bus does not start, or has died during the test.
    """
    options: dict[str, Any] = {}
    for marker in reversed([*request.node.iter_markers("dynamixel_bus")]):
        if marker.args:
            raise pytest.UsageError(
                f"dynamixel_bus: found {marker.args[0]!r} without a name, wanted {_MARKER}"
            )
        options |= marker.kwargs  # markers nearer to the test take precedence
    try:
        bus = DynamixelBus(**options)
    except TypeError as error:
        raise pytest.UsageError(f"dynamixel_bus: {error}; wanted {_MARKER}") from error
    with bus:
        yield bus
