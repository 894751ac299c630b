"""The codec against published frames, its own inverse, and damaged streams."""

import random

from dynamixel_sdk import robotis_def
from hypothesis import assume, given, strategies
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ExpectedReplies,
    FastReply,
    Frame,
    Instruction,
    Parser,
    crc16,
    encode,
    encode_fast_status,
    encode_status,
)

# Every payload is drawn to be full of the sequence that needs stuffing.
tricky = st.lists(
    st.sampled_from([b"\xff\xff\xfd", b"\xff\xff\xfd\xfd", b"\xff", b"\xfd", b"\x00", b"\x55"]),
    max_size=40,
).map(b"".join)
payloads = st.one_of(st.binary(max_size=60), tricky)
ids = st.one_of(st.integers(0, 252), st.just(BROADCAST))

FAST_REPLY = bytes.fromhex(
    "FF FF FD 00 FE 19 00 5500 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E"
)
FAST_SHARES = [
    FastReply(3, 0, bytes.fromhex("A6 00 00 00")),
    FastReply(7, 0, bytes.fromhex("1F 08 00 00")),
    FastReply(4, 0, bytes.fromhex("FF 03 00 00")),
]


def test_published_fast_sync_reply() -> None:
    assert encode_fast_status(FAST_SHARES) == FAST_REPLY
    assert parts(Parser(joint=3).feed(FAST_REPLY)) == FAST_SHARES
    # Every servo's CRC covers everything before it, so each prefix checks on its own.
    for end in (14, 22, 30):
        assert crc16(FAST_REPLY[:end]) == int.from_bytes(FAST_REPLY[end : end + 2], "little")


def test_instructions_have_the_numbers_of_the_manufacturers_library() -> None:
    """A servo answers none that it does not know; clients and emulated servos share this table."""
    theirs = {
        name[5:]: code for name, code in vars(robotis_def).items() if name.startswith("INST_")
    }
    named = {one.name: one.value for one in Instruction}
    known = named.keys() & theirs.keys()
    assert len(known) > 8
    assert {name: theirs[name] for name in known} == {name: named[name] for name in known}


def test_noise_before_and_between_frames_is_counted_once_a_run() -> None:
    parser, frame = Parser(), encode(1, Instruction.PING)
    for noise, corrupt in ((b"\x01\x02", 1), (b"\xff\xff\x00\xff", 2), (b"", 2), (b"\xfd", 3)):
        assert len(parser.feed(noise + frame)) == 1
        assert parser.corrupt == corrupt
    assert parser.feed(b"\x00" * 9) == [] and parser.corrupt == 4


def test_crc_is_that_of_its_definition_bit_by_bit() -> None:
    """For any length, odd or even, and from any start: polynomial x^16 + x^15 + x^2 + 1."""
    source = random.Random(3)
    for size in (*range(301), 2047):
        data, start = source.randbytes(size), source.randrange(1 << 16)
        crc = start
        for bit in (byte >> place & 1 for byte in data for place in range(7, -1, -1)):
            crc = (crc << 1 & 0xFFFF) ^ (0x8005 if (crc >> 15) ^ bit else 0)
        assert crc16(data, start) == crc16(memoryview(bytearray(data)), start) == crc


def test_every_short_payload_of_the_stuffing_alphabet_survives() -> None:
    """All strings of up to 8 bytes over FF, FD and 00: the cases where naive stuffing loses one."""
    alphabet = (b"\xff", b"\xfd", b"\x00")
    strings = [b""]
    parser = Parser()
    for _ in range(8):
        strings = [s + c for s in strings for c in alphabet]
        for params in strings:
            (frame,) = parser.feed(encode(1, Instruction.WRITE, params))
            assert frame.params == params
    assert parser.corrupt == 0


@given(
    st.lists(st.tuples(st.integers(0, 252), payloads), max_size=6),
    st.lists(st.integers(1, 9), min_size=1, max_size=20),
)
def test_any_cutting_of_the_stream_gives_the_same_frames(
    messages: list[tuple[int, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(encode_status(i, 0, p) for i, p in messages)
    parser = Parser()
    found = []
    at = turn = 0
    while at < len(stream):
        size = cuts[turn % len(cuts)]
        found += parser.feed(stream[at : at + size])
        at += size
        turn += 1
    assert found == [Frame(i, Instruction.STATUS, 0, p) for i, p in messages]
    assert parser.corrupt == 0


@given(st.data())
def test_frame_behind_a_damaged_one_is_found_at_once(data: strategies.DataObject) -> None:
    """One byte of a reply is altered or the reply is cut; the next one still comes through."""
    params = data.draw(payloads)
    first = bytearray(encode_status(9, 0, params))
    whole = bytes(first)
    second = encode_status(5, 0, b"abcd")
    where = data.draw(st.integers(7, len(first) - 1))
    if data.draw(st.booleans()):
        first[where] ^= data.draw(st.integers(1, 255))
    else:
        del first[where:]
    # A CRC that ends in FF is made whole by the next header's first byte: then it is no damage.
    assume(not (bytes(first) + second).startswith(whole))
    parser = Parser()
    found = parser.feed(bytes(first) + second)
    assert found[-1:] == [Frame(5, Instruction.STATUS, 0, b"abcd")]
    assert len(found) == 1
    assert parser.corrupt >= 1


def parts(frames: list[Frame]) -> list[FastReply]:
    """What a joint reply holds of each servo."""
    assert all(frame.instruction == Instruction.STATUS for frame in frames)
    return [FastReply(frame.id, frame.error, frame.params) for frame in frames]


@given(st.integers(0, 25), st.booleans(), st.integers(1, 40))
def test_of_a_joint_reply_that_ends_early_or_is_damaged_the_parts_in_front_are_found(
    at: int, cut: bool, piece: int
) -> None:
    """And the frames behind it, joint or not."""
    at += 7
    damaged = FAST_REPLY[:at] if cut else FAST_REPLY[:at] + b"\x5a" + FAST_REPLY[at + 1 :]
    assume(damaged != FAST_REPLY)
    stream = damaged + FAST_REPLY + encode_status(9, 0, b"abcd")
    parser = Parser(joint=3)
    found = [f for n in range(0, len(stream), piece) for f in parser.feed(stream[n : n + piece])]
    front = [one for n, one in enumerate(FAST_SHARES) if at >= 16 + 8 * n]
    assert parts(found) == [*front, *FAST_SHARES, FastReply(9, 0, b"abcd")]
    assert parser.corrupt == (not cut or at % 8 > 0)
    assert parser.idle


def raw_instruction(id_: int, params: bytes) -> bytes:
    """A write as a host sends it that does not stuff."""
    body = bytes([Instruction.WRITE]) + params
    frame = b"\xff\xff\xfd\x00" + bytes([id_]) + (len(body) + 2).to_bytes(2, "little") + body
    return frame + crc16(frame).to_bytes(2, "little")


header_rich = st.lists(
    st.sampled_from([b"\xff\xff\xfd\x00", b"\xff\xff\xfd\x00\x01\x09\x00", b"\xff", b"\x00\x07"]),
    max_size=12,
).map(b"".join)


@given(
    st.lists(st.tuples(st.integers(0, 252), header_rich), min_size=1, max_size=4),
    st.integers(1, 30),
)
def test_headers_that_are_not_stuffed_are_data_where_that_is_allowed(
    messages: list[tuple[int, bytes]], cut: int
) -> None:
    stream = b"".join(raw_instruction(id_, params) for id_, params in messages)
    parser = Parser(report_crc=True, unstuffed=True)
    found = [f for at in range(0, len(stream), cut) for f in parser.feed(stream[at : at + cut])]
    assert found == [Frame(i, Instruction.WRITE, 0, p) for i, p in messages]
    assert parser.idle


def test_a_long_frame_behind_a_truncated_one_is_found_where_headers_may_be_data() -> None:
    cut, behind = encode(1, Instruction.WRITE, bytes(40))[:20], encode(2, 3, bytes(252))
    assert Parser(unstuffed=True).feed(cut + behind) == [Frame(2, 3, 0, bytes(252))]


@given(
    st.lists(st.integers(0, 252), min_size=1, max_size=40, unique=True),
    st.integers(2, 20),
    st.booleans(),
)
def test_a_cycle_recognises_the_replies_of_its_own_servos_and_no_others(
    ids: list[int], size: int, fast: bool
) -> None:
    """One after the other, or in a joint one."""
    replies = [
        FastReply(id_, id_ % 128, bytes((id_ + n) % 256 for n in range(size))) for id_ in ids
    ]
    expected = ExpectedReplies(ids, size, "H", joint=fast)
    wire = encode_fast_status(replies) if fast else b"".join(encode_status(*one) for one in replies)
    found = expected.match(wire)
    assert found is not None
    values = [(one.error, int.from_bytes(one.data[:2], "little")) for one in replies]
    assert list(found) == values
    for other in (wire[:-1], wire + b"\x00", b""):
        assert expected.match(other) is None
    for at in {*range(9), len(wire) // 2, len(wire) - 2, len(wire) - 1}:
        for flip in (0x01, 0x80):
            damaged = bytearray(wire)
            damaged[at] ^= flip
            assert expected.match(bytes(damaged)) is None, f"byte {at} is another"
    assert parts(Parser(joint=len(ids) if fast else 0).feed(wire)) == replies
