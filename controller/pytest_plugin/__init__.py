"""Provides an emulated Dynamixel bus for the tests of any program that uses one.

It is a pytest plugin, active once the distribution is installed: the fixture ``dynamixel_bus``
starts ``haptic-wall emulate`` in a process of its own. It imports nothing of that program, so that
it costs the tests no time and shares no interpreter with the program under test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

from haptic_wall.controller.emulated_bus.bus import BusError, DynamixelBus
from haptic_wall.controller.emulated_bus.record import BusRow

pytest.register_assert_rewrite(f"{__name__}.servo_contract")

__all__ = ["BusError", "BusRow", "DynamixelBus", "dynamixel_bus"]

_BUS = pytest.StashKey[DynamixelBus]()
_MOST_WAIT_S = 0.02
"""A bus that waited longer for a processor may have made a test fail [s]"""
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
    request.node.stash[_BUS] = bus
    with bus:
        yield bus


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Repeat a failed test once if the processor kept its emulated bus waiting, and say so."""
    if "dynamixel_bus" not in getattr(item, "fixturenames", ()):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    if any(report.failed for report in reports) and (waited := _waited_s(item)) > _MOST_WAIT_S:
        item._initrequest()  # type: ignore[attr-defined]  # its fixtures are made anew
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        text = (
            f"The emulated bus got no processor for {waited * 1e3:.0f} ms, so replies were late. "
            "The test was run once more."
        )
        for report in reports:
            report.sections.append(("dynamixel_bus", text))
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _waited_s(item: pytest.Item) -> float:
    bus = item.stash.get(_BUS, None)
    return 0.0 if bus is None else bus.waited_s
