"""The adapter's timer and blocks, against a byte-by-byte account of the same rule."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode
from haptic_wall.hw.emulated.adapter import Adapter
from tests.hw.dynamixel.emulated_client import BAUD, BYTE_NS, MS, US, Client
from tests.typed import not_none

READ = encode(1, Instruction.READ, bytes([120, 0, 16, 0]))
WIRE_NS = (len(READ) + 27) * BYTE_NS
"""Of the request and of its reply"""


def reply_at(client: Client, deadline_ns: int) -> int | None:
    """When the last byte of a reply was handed over [ns]; None: not by the deadline."""
    parser = Parser()
    while client.line.wait(deadline_ns):
        if parser.feed(client.line.read()):
            return client.clock.now_ns()
    return None


def account(
    arrivals: Sequence[int], timer_ns: int, block: int, start_ns: int, end_ns: int
) -> list[tuple[int, int]]:
    """Every hand-over, by looking at each byte and each expiry one after the other."""
    handed, held, sent_ns = [], 0, start_ns
    waiting = sorted(arrivals)
    while waiting or sent_ns + timer_ns <= end_ns:
        if waiting and waiting[0] <= sent_ns + timer_ns:
            now_ns, held = waiting.pop(0), held + 1
            if held < block:
                continue
        else:
            now_ns = sent_ns + timer_ns
        sent_ns = now_ns
        if held:
            handed.append((now_ns, held))
            held = 0
    return handed


@settings(max_examples=2 * settings().max_examples)
@given(
    st.lists(
        st.tuples(st.integers(0, 3 * MS), st.integers(1, 150), st.sampled_from([57_600, BAUD])),
        max_size=8,
    ),
    st.sampled_from([1 * MS, 2 * MS, 16 * MS]),
    st.sampled_from([1, 62, 510]),
    st.integers(0, 20 * MS),
)
def test_every_byte_is_handed_over_when_the_rule_says(
    stretches: list[tuple[int, int, int]], timer_ns: int, block: int, phase_ns: int
) -> None:
    adapter = Adapter(timer_ns, block, phase_ns)
    sent, arrivals, handed = b"", [], []
    free_ns = phase_ns
    for pause_ns, count, baud in stretches:
        data = bytes((len(sent) + n) % 251 for n in range(count))
        start_ns = free_ns + pause_ns
        adapter.put(data, start_ns, baud)
        arrivals += [start_ns + (n + 1) * 10_000_000_000 // baud for n in range(count)]
        free_ns = arrivals[-1]
        sent += data
    got = b""
    while (time_ns := adapter.next_ns()) is not None:
        assert adapter.take(time_ns - 1) == b""
        taken = adapter.take(time_ns)
        handed.append((time_ns, len(taken)))
        got += taken
    assert got == sent
    assert not adapter.holds
    # Where a byte is through at the very instant of an expiry it goes with it.
    assert handed == account(arrivals, timer_ns, block, phase_ns, free_ns + timer_ns)


def test_taking_late_gives_the_same_bytes() -> None:
    often, seldom = (Adapter(MS, 62, 0) for _ in range(2))
    for adapter in (often, seldom):
        adapter.put(bytes(range(200)), 100, BAUD)
    given_ = b"".join(often.take(n * 10 * US) for n in range(300))
    assert given_ == seldom.take(3 * MS) == bytes(range(200))


@pytest.mark.parametrize("phase_us", range(0, 1000, 37))
def test_a_reply_waits_for_the_timer_whenever_it_was_asked_for(phase_us: int) -> None:
    """The expiries lie on a grid; where in it the request falls decides about the wait."""
    client = Client(fast=False, adapter=Adapter(MS, 62, 5 * MS - phase_us * US))
    client.servos[1].memory["return_delay_time"] = 0
    client.line.write(READ)
    through = 5 * MS + WIRE_NS
    handed = not_none(reply_at(client, 20 * MS))
    assert through <= handed <= through + MS
    assert (handed - (5 * MS - phase_us * US)) % MS == 0


def test_a_full_block_does_not_wait_and_restarts_the_timer() -> None:
    client = Client(fast=False, adapter=Adapter(16 * MS, 62, 5 * MS))
    client.servos[1].memory["return_delay_time"] = 0
    client.line.write(encode(1, Instruction.READ, bytes([0, 0, 80, 0])))  # a reply of 91 bytes
    full = 5 * MS + (14 + 62) * BYTE_NS
    assert client.line.wait(20 * MS)
    assert client.clock.now_ns() == full
    assert len(client.line.read()) == 62
    assert client.line.wait(40 * MS)
    assert client.clock.now_ns() == full + 16 * MS
    assert len(client.line.read()) == 29
