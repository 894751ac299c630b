"""Encodes and decodes Dynamixel Protocol 2.0: pure functions, without port and clock.

Shared by the driver and the emulated bus.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from haptic_wall.hw.dynamixel.codec.cyclic import ExpectedReplies, SyncWrite
from haptic_wall.hw.dynamixel.codec.frames import (
    ALERT,
    BROADCAST,
    MAX_ID,
    MAX_LENGTH,
    ErrorCode,
    FastReply,
    Frame,
    Instruction,
    crc16,
    encode,
    encode_fast_status,
    encode_status,
)
from haptic_wall.hw.dynamixel.codec.parser import Parser

__all__ = [
    "ALERT",
    "BROADCAST",
    "MAX_ID",
    "MAX_LENGTH",
    "ErrorCode",
    "ExpectedReplies",
    "FastReply",
    "Frame",
    "Instruction",
    "Parser",
    "SyncWrite",
    "crc16",
    "encode",
    "encode_fast_status",
    "encode_status",
]
