"""The control table's rules, as a client meets them on the wire."""

import math
from dataclasses import replace

import pytest

from haptic_wall.hw.dynamixel.codec import ALERT, ErrorCode, Instruction
from haptic_wall.hw.dynamixel.tables import MODELS
from tests.hw.dynamixel.emulated_client import FREE, MS, TORQUE_UNIT, Client

ID, RETURN_DELAY, DRIVE_MODE, OPERATING_MODE, HOMING = 7, 9, 10, 11, 20
TEMPERATURE_LIMIT, CURRENT_LIMIT, STARTUP = 31, 38, 60
TORQUE_ENABLE, LED, RETURN_LEVEL, WATCHDOG = 64, 65, 68, 98
GOAL_PWM, GOAL_CURRENT, GOAL_VELOCITY, GOAL_POSITION = 100, 102, 104, 116
TICK, MOVING, CURRENT, VELOCITY, POSITION = 120, 122, 126, 128, 132


def test_current_mode_starts_at_the_current_limit() -> None:
    """The trap of the real servo: torque that is enabled without writing 0 is the largest."""
    client = Client()
    assert client.write(1, GOAL_CURRENT, 7, 2) == 0
    assert client.write(1, OPERATING_MODE, 0, 1) == 0
    assert client.read(1, GOAL_CURRENT, 2) == 1193
    assert client.write(1, TORQUE_ENABLE, 1, 1) == 0
    assert client.torque() == pytest.approx(1193 * TORQUE_UNIT)


@pytest.mark.parametrize("address", [ID, RETURN_DELAY, OPERATING_MODE, CURRENT_LIMIT, STARTUP])
def test_eeprom_is_locked_while_torque_is_enabled(address: int) -> None:
    client = Client()
    size = 2 if address == CURRENT_LIMIT else 1
    before = client.read(1, address, size)
    client.write(1, TORQUE_ENABLE, 1, 1)
    assert client.write(1, address, before, size) == ErrorCode.ACCESS
    client.write(1, TORQUE_ENABLE, 0, 1)
    assert client.write(1, address, before, size) == 0


@pytest.mark.parametrize(
    ("address", "value", "size", "error"),
    [
        (ID, 253, 1, ErrorCode.DATA_RANGE),
        (8, 8, 1, ErrorCode.DATA_RANGE),
        (OPERATING_MODE, 1, 1, ErrorCode.DATA_RANGE),
        (OPERATING_MODE, 2, 1, ErrorCode.DATA_RANGE),
        (OPERATING_MODE, 17, 1, ErrorCode.DATA_RANGE),
        (CURRENT_LIMIT, 1194, 2, ErrorCode.DATA_RANGE),
        (TORQUE_ENABLE, 2, 1, ErrorCode.DATA_RANGE),
        (WATCHDOG, 128, 1, ErrorCode.DATA_RANGE),
        (GOAL_CURRENT, 1194, 2, ErrorCode.DATA_LIMIT),
        (GOAL_CURRENT, -1194, 2, ErrorCode.DATA_LIMIT),
        (GOAL_PWM, 886, 2, ErrorCode.DATA_LIMIT),
        (GOAL_VELOCITY, -201, 4, ErrorCode.DATA_LIMIT),
        (GOAL_POSITION, 4096, 4, ErrorCode.DATA_LIMIT),
        (GOAL_CURRENT, 1, 1, ErrorCode.DATA_LENGTH),
        (103, 1, 1, ErrorCode.DATA_LENGTH),
        (POSITION, 0, 4, ErrorCode.ACCESS),
        (0, 1020, 2, ErrorCode.ACCESS),
        (66, 0, 1, ErrorCode.ACCESS),
        (LED, 0, 2, ErrorCode.ACCESS),
        (4000, 0, 1, ErrorCode.ACCESS),
    ],
)
def test_what_is_refused_says_why_and_changes_nothing(
    address: int, value: int, size: int, error: ErrorCode
) -> None:
    client = Client()
    before = client.servos[1].memory.read(0, 148)
    assert client.write(1, address, value, size) == error
    assert client.servos[1].memory.read(0, 148) == before


def test_a_write_over_several_registers_is_all_or_nothing() -> None:
    client = Client()
    goals = (50).to_bytes(2, "little") + (201).to_bytes(4, "little")  # velocity beyond its limit
    reply = client.answer(1, Instruction.WRITE, GOAL_CURRENT.to_bytes(2, "little") + goals)
    assert reply.error == ErrorCode.DATA_LIMIT
    assert client.read(1, GOAL_CURRENT, 2) == 1193
    goals = (50).to_bytes(2, "little") + (200).to_bytes(4, "little")
    reply = client.answer(1, Instruction.WRITE, GOAL_CURRENT.to_bytes(2, "little") + goals)
    assert reply.error == 0
    assert client.read(1, GOAL_CURRENT, 2) == 50
    assert client.read(1, GOAL_VELOCITY, 4) == 200


def test_block_read_is_one_instant() -> None:
    """Tick, current, velocity and position of a servo in free acceleration agree."""
    client = Client(tick=100)
    client.enable_current_mode()
    client.write(1, GOAL_CURRENT, 100, 2)
    client.pass_time(50 * MS)
    reply = client.answer(1, Instruction.READ, bytes([TICK, 0, 27, 0]))
    sampled = client.clock.now_ns() - (11 + 27) * 2_500
    fields = [
        int.from_bytes(reply.params[a:b], "little", signed=a in (4, 6, 8, 12))
        for a, b in ((0, 2), (2, 3), (6, 8), (8, 12), (12, 16), (24, 26), (26, 27))
    ]
    tick, moving, current, velocity, position, volts, temperature = fields
    assert tick == 100 + (sampled - 5 * MS) // MS
    assert moving == 1
    assert current == 100
    acceleration = 100 * TORQUE_UNIT / FREE.inertia
    speed = velocity * 0.229 * 2 * math.pi / 60
    travelled = position * 2 * math.pi / 4096 - FREE.position
    assert speed**2 / (2 * acceleration) == pytest.approx(travelled, abs=0.003)
    assert volts == 120
    assert 20 < temperature < 80


def test_a_tripped_watchdog_drops_the_torque_on_time_and_refuses_goals() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, WATCHDOG, 2, 1)  # 40 ms
    client.write(1, GOAL_CURRENT, 20, 2)
    last = client.clock.now_ns() - 11 * 2_500  # the reply's bytes came after
    client.clock.wait_until(last + 40 * MS - 1)
    client.bus.transmit(client.clock.now_ns())
    assert client.torque() > 0
    client.clock.wait_until(last + 40 * MS)
    client.bus.transmit(client.clock.now_ns())
    assert client.torque() == 0.0
    assert client.read(1, WATCHDOG, 1) == 255
    assert client.read(1, TORQUE_ENABLE, 1) == 1
    for address, size in ((GOAL_PWM, 2), (GOAL_CURRENT, 2), (GOAL_VELOCITY, 4), (GOAL_POSITION, 4)):
        assert client.write(1, address, 1, size) == ErrorCode.DATA_RANGE
    assert client.write(1, WATCHDOG, 5, 1) == ErrorCode.DATA_RANGE
    assert client.write(1, WATCHDOG, 0, 1) == 0
    assert client.torque() == 0.0  # the old goal does not come back
    assert client.write(1, GOAL_CURRENT, 20, 2) == 0
    assert client.torque() > 0


def test_what_restarts_the_watchdog() -> None:
    client = Client(("XM430-W350", 1), ("XM430-W350", 2))
    client.enable_current_mode()
    client.write(1, WATCHDOG, 1, 1)
    for _ in range(4):  # listed in a sync write, addressed, broadcast
        client.pass_time(15 * MS)
        client.sync_write(GOAL_CURRENT, 2, {1: 10})
        client.pass_time(15 * MS)
        client.send(1, Instruction.PING)
        client.pass_time(15 * MS)
        client.send(0xFE, Instruction.WRITE, bytes([LED, 0, 1]))
    assert client.torque() > 0
    for _ in range(2):  # neither of these is for it
        client.pass_time(8 * MS)
        client.send(2, Instruction.PING)
        client.pass_time(8 * MS)
        client.sync_write(GOAL_CURRENT, 2, {2: 10})
    client.pass_time(MS)
    assert client.torque() == 0.0


@pytest.mark.parametrize(("firmware", "on"), [(44, 0), (45, 1)])
def test_torque_on_by_goal_update(firmware: int, on: int) -> None:
    client = Client(firmware=firmware)
    client.write(1, DRIVE_MODE, 8, 1)
    client.write(1, OPERATING_MODE, 0, 1)
    client.write(1, GOAL_CURRENT, 0, 2)
    assert client.read(1, TORQUE_ENABLE, 1) == on


def test_position_counts_over_turns_and_a_reboot_forgets_them() -> None:
    client = Client(true=replace(FREE, position=-0.1))
    counts = round(-0.1 * 4096 / (2 * math.pi))
    assert client.read(1, POSITION, 4, signed=True) == counts
    client.ask(1, Instruction.REBOOT)
    client.pass_time(500 * MS)
    assert client.read(1, POSITION, 4, signed=True) == counts + 4096


@pytest.mark.parametrize(
    ("level", "answered"), [(0, {"ping"}), (1, {"ping", "read"}), (2, {"ping", "read", "write"})]
)
def test_status_return_level(level: int, answered: set[str]) -> None:
    client = Client()
    client.send(1, Instruction.WRITE, bytes([RETURN_LEVEL, 0, level]))
    client.replies()
    asked = {
        "ping": client.ask(1, Instruction.PING),
        "read": client.ask(1, Instruction.READ, bytes([LED, 0, 1, 0])),
        "write": client.ask(1, Instruction.WRITE, bytes([LED, 0, 1])),
    }
    assert {name for name, reply in asked.items() if reply is not None} == answered
    assert client.servos[1].memory["led"] == 1  # done, answered or not


def test_shutdown_keeps_torque_off_until_reboot() -> None:
    client = Client()
    assert client.write(1, TEMPERATURE_LIMIT, 20, 1) == ALERT
    assert client.write(1, TORQUE_ENABLE, 1, 1) == ALERT | ErrorCode.RESULT_FAIL
    assert client.read(1, TORQUE_ENABLE, 1) == 0
    client.write(1, TEMPERATURE_LIMIT, 80, 1)
    client.ask(1, Instruction.REBOOT)
    client.pass_time(500 * MS)
    assert client.write(1, TORQUE_ENABLE, 1, 1) == 0


def test_reboot_drops_torque_and_ram_keeps_eeprom_and_takes_time() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, GOAL_CURRENT, 50, 2)
    assert client.answer(1, Instruction.REBOOT).error == 0
    assert client.torque() == 0.0
    assert client.ask(1, Instruction.PING) is None
    client.pass_time(500 * MS)
    assert client.ask(1, Instruction.PING) is not None
    assert client.read(1, TORQUE_ENABLE, 1) == 0
    assert client.read(1, OPERATING_MODE, 1) == 0
    assert client.read(1, GOAL_CURRENT, 2) == 1193


def test_a_servo_without_published_stall_data_needs_a_torque_constant() -> None:
    with pytest.raises(ValueError, match="XD540-T270"):
        Client(("XD540-T270", 1))
    Client(("XD540-T270", 1), true=replace(FREE, torque_constant=2.0))


@pytest.mark.parametrize("name", MODELS)
def test_every_model_can_be_emulated_at_every_firmware(name: str) -> None:
    constant = replace(FREE, torque_constant=1.0)
    for firmware in (36, 38, 44, 46, 53):
        client = Client((name, 1), true=constant, firmware=firmware)
        reply = client.answer(1, Instruction.PING)
        assert reply.params == MODELS[name].number.to_bytes(2, "little") + bytes([firmware])
        size = max(r.address + r.size for r in MODELS[name].registers_at(firmware).values())
        table = client.answer(1, Instruction.READ, bytes(2) + size.to_bytes(2, "little")).params
        for register in MODELS[name].registers_at(firmware).values():
            if register.eeprom and register.name not in ("id", "baud_rate", "return_delay_time"):
                value = register.decode(table[register.address : register.address + register.size])
                expected = {"firmware_version": firmware}.get(register.name, register.default)
                assert value == expected, register
