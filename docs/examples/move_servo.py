"""Move one Dynamixel X-series servo to an angle, and wait until it is there.

An ordinary program with dynamixel-sdk, which knows nothing of tests or emulators.
"""

import argparse
import sys
import time

import dynamixel_sdk as sdk

OPERATING_MODE, TORQUE_ENABLE, GOAL_POSITION, MOVING, POSITION = 11, 64, 116, 122, 132
POSITION_MODE = 3
COUNTS_PER_DEGREE = 4096 / 360
ALERT = 0x80
ATTEMPTS = 10


class ServoError(Exception):
    pass


class Servo:
    def __init__(self, port, id):
        self.port, self.id = port, id
        self.handler = sdk.PacketHandler(2.0)

    def read(self, address, size):
        return self._try(self.handler.readTxRx, address, size)

    def write(self, address, size, value):
        self._try(self.handler.writeTxRx, address, size, list(value.to_bytes(size, "little")))

    def _try(self, action, *arguments):
        for _ in range(ATTEMPTS):
            *data, result, error = action(self.port, self.id, *arguments)
            if result != sdk.COMM_SUCCESS:
                continue
            if error & ALERT:
                raise ServoError(f"servo {self.id} has shut down: reboot it")
            if error:
                raise ServoError(f"servo {self.id}: {self.handler.getRxPacketError(error)}")
            return int.from_bytes(bytes(data[0]), "little") if data else None
        raise ServoError(f"servo {self.id} gives no good answer: check id, baud rate and power")


def move(servo, degrees, within_s=3.0, tolerance=2.0):
    servo.write(TORQUE_ENABLE, 1, 0)
    servo.write(OPERATING_MODE, 1, POSITION_MODE)
    servo.write(TORQUE_ENABLE, 1, 1)
    try:
        servo.write(GOAL_POSITION, 4, round(degrees * COUNTS_PER_DEGREE))
        end = time.monotonic() + within_s
        while abs(servo.read(POSITION, 4) / COUNTS_PER_DEGREE - degrees) > tolerance or servo.read(
            MOVING, 1
        ):
            if time.monotonic() > end:
                raise ServoError(f"servo {servo.id} did not get there in {within_s} s")
    finally:
        servo.write(TORQUE_ENABLE, 1, 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("degrees", type=float)
    parser.add_argument("--port", default="/dev/ttyUSB0")
    parser.add_argument("--baud", type=int, default=57600)
    parser.add_argument("--id", type=int, default=1)
    arguments = parser.parse_args()
    port = sdk.PortHandler(arguments.port)
    port.baudrate = arguments.baud
    port.openPort()
    try:
        move(Servo(port, arguments.id), arguments.degrees)
    except ServoError as error:
        sys.exit(f"move_servo: {error}")
    finally:
        port.closePort()


if __name__ == "__main__":
    main()
