"""The adapter's timer and blocks, against a byte-by-byte account of the same rule."""

from collections.abc import Sequence

from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import Instruction, encode
from haptic_wall.hw.emulated.adapter import Adapter
from tests.hw.dynamixel.emulated_client import BAUD, BYTE_NS, MS, Client

"""Of the request and of its reply"""


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
