"""Packs rows into the binary messages that the page reads."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.columns import values

CHANNELS: Final = (
    "position_rad",
    "velocity_rad_s",
    "torque_nm",
    "wall_torque_nm",
    "measured_torque_nm",
    "lateness_us",
    "sample_age_us",
    "stiffness",
    "damping",
    "delay_s",
    "flags",
)
"""Columns of a message besides the time, in their order; named as in a CSV"""
_HEAD: Final = struct.Struct("<dII")


def frame(rows: NDArray[np.void], origin_ns: int) -> bytes:
    """Return rows as one message.

    The message has, little-endian: the number of the first row as float64; the number of rows and
    that of channels as uint32; the times [s] as float64; then each channel as float32, and last the
    positions of the other axes.

    Args:
        rows: Shape (n, axes), dtype ``telemetry.ROW``; first the axis that is shown.
        origin_ns: Zero of the time [ns].
    """
    shown, others = rows[:, 0], rows["position"][:, 1:].T
    parts = [_HEAD.pack(float(shown["seq"][0]), len(rows), len(CHANNELS) + len(others))]
    parts.append(values(shown, "time_s", origin_ns).astype("<f8").tobytes())
    parts += [values(shown, name, origin_ns).astype("<f4").tobytes() for name in CHANNELS]
    parts.append(others.astype("<f4").tobytes())
    return b"".join(parts)
