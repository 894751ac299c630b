"""Tests of move_servo.py without a servo. They judge by what the servo truly did."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("move_servo.py")


def move(bus, degrees, id=1):
    words = [sys.executable, SCRIPT, "--port", bus.port, "--baud", bus.baud, "--id", id, degrees]
    return subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.dynamixel_bus(
    servos=["XM430-W350:1", "XL330-M288:2"],
    baud=1_000_000,
    truth={"inertia": 5e-4, "damping": 1e-3, "coulomb": 0.01},  # little to turn for the small one
)
@pytest.mark.parametrize("id", [1, 2])
def test_it_goes_where_it_is_sent_and_lets_go(dynamixel_bus, id):
    done = move(dynamixel_bus, 200, id)
    assert done.returncode == 0, done.stderr
    dynamixel_bus.stop()  # the record is complete then
    assert math.degrees(dynamixel_bus.position(id)) == pytest.approx(200, abs=3)
    assert max(row.torque_nm for row in dynamixel_bus.events("state", id)) > 0
    assert dynamixel_bus.state(id).torque_nm == 0


@pytest.mark.dynamixel_bus(faults=["drop:p=0.05", "corrupt:p=0.05,way=reply"], seed=1)
def test_lost_and_broken_replies_do_not_stop_it(dynamixel_bus):
    done = move(dynamixel_bus, 200)
    assert done.returncode == 0, done.stderr
    assert dynamixel_bus.events("fault")


def test_a_servo_that_has_shut_down_is_named(dynamixel_bus):
    dynamixel_bus.inject("hardware-error:bits=overload")
    done = move(dynamixel_bus, 200)
    assert done.returncode == 1
    assert "servo 1 has shut down" in done.stderr


@pytest.mark.dynamixel_bus(servos=["XM430-W350:7"])
def test_a_servo_that_is_not_there_is_an_error_and_no_wait_for_ever(dynamixel_bus):
    done = move(dynamixel_bus, 200, id=1)
    assert done.returncode == 1
    assert "servo 1 gives no good answer" in done.stderr
