"""Rows of the shared memory, by the names of their fields."""

from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS


def row(**values: float) -> list[float]:
    """The values to write; fields that are not given are 0."""
    fields = [*INT_FIELDS[1:], *FLOAT_FIELDS]
    assert set(values) <= set(fields)
    return [values.get(name, 0) for name in fields]
