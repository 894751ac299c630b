"""Indirect addresses: scattered registers read and written in one piece."""

from hypothesis import given, settings, strategies
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import Instruction
from tests.hw.dynamixel.emulated_client import Client

LED, HOMING, WATCHDOG, GOAL_CURRENT, GOAL_POSITION = 65, 20, 98, 102, 116
TICK, CURRENT, POSITION = 120, 126, 132
ADDRESS_1, DATA_1, ADDRESS_29, DATA_29 = 168, 224, 578, 634


def words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


def show(client: Client, *addresses: int, first: int = ADDRESS_1) -> None:
    """Have Indirect Data show these bytes, in this order."""
    reply = client.ask(1, Instruction.WRITE, words(first, *addresses))
    assert reply is not None
    assert reply.error == 0


def test_the_manuals_first_example() -> None:
    client = Client()
    show(client, LED)
    assert client.write(1, DATA_1, 1, 1) == 0
    assert client.read(1, LED, 1) == 1
    assert client.write(1, LED, 0, 1) == 0
    assert client.read(1, DATA_1, 1) == 0


@settings(max_examples=60)
@given(st.data())
def test_a_read_through_any_addresses_is_the_bytes_they_name(data: strategies.DataObject) -> None:
    """Against one read of the whole table, which knows nothing of indirection."""
    client = Client()
    client.ask(1, Instruction.WRITE, words(DATA_1 + 20) + bytes(range(8)))  # stay as they are
    # Neither what moves on by itself nor Indirect Data nor the addresses that are being set.
    plain = st.one_of(st.integers(64, 119), st.integers(128, 167), st.integers(578, 633))
    wanted = data.draw(st.lists(plain, min_size=1, max_size=20))
    show(client, *wanted)
    first = data.draw(st.integers(0, len(wanted) - 1))
    last = data.draw(st.integers(first, len(wanted) - 1))
    table = client.answer(1, Instruction.READ, words(0, 662)).params
    got = client.answer(1, Instruction.READ, words(DATA_1 + first, last - first + 1)).params
    assert got == bytes(table[address] for address in wanted[first : last + 1])
    assert table[DATA_1 : DATA_1 + len(wanted)] == bytes(table[address] for address in wanted)
