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
    that of channels as uint32; the times [s] as float64; then each channel as float32.

    Args:
        rows: Shape (n,), n > 0, dtype ``telemetry.ROW``.
        origin_ns: Zero of the time [ns].
    """
    parts = [_HEAD.pack(float(rows["seq"][0]), len(rows), len(CHANNELS))]
    parts.append(values(rows, "time_s", origin_ns).astype("<f8").tobytes())
    parts += [values(rows, name, origin_ns).astype("<f4").tobytes() for name in CHANNELS]
    return b"".join(parts)
