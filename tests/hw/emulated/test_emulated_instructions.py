"""Instructions for several servos, and several with one id, as a client meets them on the wire.

Frames marked as published are those of the e-manual's examples.
"""

from haptic_wall.hw.dynamixel.codec import Instruction
from tests.hw.dynamixel.emulated_client import Client

ID, LED = 7, 65
X = "XM430-W350"


def words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


# Bulk


def test_bulk_read_is_answered_by_each_in_the_order_asked() -> None:
    client = Client((X, 1), (X, 2))
    client.line.write(  # published: voltage of 1, temperature of 2
        bytes.fromhex("FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05")
    )
    replies = client.replies()
    assert [(r.id, r.error, r.params) for r in replies] == [
        (1, 0, words(120)),
        (2, 0, bytes([client.read(2, 146, 1)])),
    ]


# Two servos with one id


def leds(client: Client) -> list[int]:
    return [servo.memory["led"] for servo in client.servos.values()]


def test_different_answers_of_one_id_collide_and_both_obey() -> None:
    client = Client((X, 1), ("XL330-M288", 2))
    client.write(2, ID, 1, 1)
    client.send(1, Instruction.PING)
    assert client.replies() == []  # bytes came, but no frame
    client.send(1, Instruction.WRITE, words(LED) + b"\x01")
    client.replies()
    assert leds(client) == [1, 1]
    client.write(1, LED, 0, 1)  # the same answer of both comes through
    assert leds(client) == [0, 0]
