"""A held pose whose replies need byte stuffing is read right."""

import dynamixel_sdk as sdk
import pytest


@pytest.mark.dynamixel_bus(servos=["XM430-W350:1", "XM430-W350:2"], faults=["stuffing:id=2"])
def test_a_held_pose_is_read(dynamixel_bus):
    port = sdk.PortHandler(dynamixel_bus.port)
    port.baudrate = dynamixel_bus.baud
    assert port.openPort()
    reads = sdk.GroupSyncRead(port, sdk.PacketHandler(2.0), 126, 10)
    assert reads.addParam(1) and reads.addParam(2)
    assert reads.txRxPacket() == sdk.COMM_SUCCESS
    assert reads.getData(2, 126, 2) == 0xFFFF  # current -1
    assert reads.getData(2, 128, 4) == 0xFFFF_FFFD  # velocity -3
    assert reads.getData(2, 132, 4) == 2048
    port.closePort()
