"""A pseudo-terminal, or a bus in memory, has no cable: whatever fails, other advice is given."""

import os
import tty
from pathlib import Path

import pytest

from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.errors import ServoError, ServoLostError, wiring
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.serialport.line import FdLine
from haptic_wall.hw.settings import ServoSettings


def test_the_advice_fits_what_is_at_the_other_end(tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    port = tmp_path / "bus"
    port.symlink_to(os.ttyname(slave))
    for name in (str(port), f"id 1 on {port}", "", "XM430-W350 id 1 on memory"):
        assert wiring(name) == "that the emulated bus runs and gets processor time"
    assert wiring("id 1 at 57600 baud on /dev/ttyUSB0") == "the cable and the power supply"
    settings = ServoSettings(str(port), 4_000_000, 1, "XM430-W350", backend="dynamixel")
    servo = open_bus([settings], MonotonicClock())
    line = FdLine(os.dup(slave), MonotonicClock())
    with pytest.raises(ServoError) as silent:
        servo.start()
    servo.close()
    os.close(slave)
    os.close(master)
    with pytest.raises(ServoLostError) as gone:
        line.write(b"x")
    line.close()
    for error in (silent, gone):
        assert "cable" not in str(error.value) and "emulated bus runs" in str(error.value)
