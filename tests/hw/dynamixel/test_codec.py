"""The codec against published frames, its own inverse, and damaged streams."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hw.dynamixel.codec import (
    BROADCAST,
    MAX_LENGTH,
    ErrorCode,
    ExpectedReply,
    FastReply,
    Frame,
    Instruction,
    Parser,
    crc16,
    decode_fast_status,
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

PUBLISHED_INSTRUCTIONS = [
    (1, Instruction.PING, "", "FF FF FD 00 01 03 00 01 19 4E"),
    (1, Instruction.READ, "84 00 04 00", "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
    (1, Instruction.WRITE, "74 00 00 02 00 00", "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89"),
    (
        BROADCAST,
        Instruction.SYNC_READ,
        "84 00 04 00 01 02",
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    ),
    (
        BROADCAST,
        Instruction.SYNC_WRITE,
        "74 00 04 00 01 96 00 00 00 02 AA 00 00 00",
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    (1, Instruction.REBOOT, "", "FF FF FD 00 01 03 00 08 2F 4E"),
    (
        BROADCAST,
        Instruction.FAST_SYNC_READ,
        "84 00 04 00 03 07 04",
        "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
    ),
]

PUBLISHED_REPLIES = [
    (1, 0, "06 04 26", "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"),
    (1, 0, "A6 00 00 00", "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"),
    (1, 0, "", "FF FF FD 00 01 04 00 55 00 A1 0C"),
]

FAST_REPLY = bytes.fromhex(
    "FF FF FD 00 FE 19 00 5500 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E"
)
FAST_SHARES = [
    FastReply(3, 0, bytes.fromhex("A6 00 00 00")),
    FastReply(7, 0, bytes.fromhex("1F 08 00 00")),
    FastReply(4, 0, bytes.fromhex("FF 03 00 00")),
]


@pytest.mark.parametrize(("id_", "instruction", "params", "wire"), PUBLISHED_INSTRUCTIONS)
def test_published_instruction(id_, instruction, params, wire):
    assert encode(id_, instruction, bytes.fromhex(params)) == bytes.fromhex(wire)
    assert Parser().feed(bytes.fromhex(wire)) == [Frame(id_, instruction, 0, bytes.fromhex(params))]


@pytest.mark.parametrize(("id_", "error", "params", "wire"), PUBLISHED_REPLIES)
def test_published_reply(id_, error, params, wire):
    assert encode_status(id_, error, bytes.fromhex(params)) == bytes.fromhex(wire)
    assert Parser().feed(bytes.fromhex(wire)) == [
        Frame(id_, Instruction.STATUS, error, bytes.fromhex(params))
    ]


def test_published_fast_sync_reply():
    assert encode_fast_status(FAST_SHARES) == FAST_REPLY
    (frame,) = Parser().feed(FAST_REPLY)
    assert decode_fast_status(frame, 4) == FAST_SHARES
    # Every servo's CRC covers everything before it, so each prefix checks on its own.
    for end in (14, 22, 30):
        assert crc16(FAST_REPLY[:end]) == int.from_bytes(FAST_REPLY[end : end + 2], "little")


def test_crc_continues_where_it_stopped():
    data = bytes(range(200))
    assert crc16(data[70:], crc16(data[:70])) == crc16(data)


@given(ids, st.sampled_from(list(Instruction)), payloads)
def test_instruction_round_trip(id_, instruction, params):
    if instruction == Instruction.STATUS:
        return
    assert Parser().feed(encode(id_, instruction, params)) == [Frame(id_, instruction, 0, params)]


@given(st.integers(0, 252), st.integers(0, 255), payloads)
def test_reply_round_trip(id_, error, params):
    parsed = Parser().feed(encode_status(id_, error, params))
    assert parsed == [Frame(id_, Instruction.STATUS, error, params)]


def test_every_short_payload_of_the_stuffing_alphabet_survives():
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


@given(ids, payloads)
def test_length_and_crc_count_stuffed_bytes_and_no_header_is_inside(id_, params):
    wire = encode(id_, Instruction.WRITE, params)
    assert int.from_bytes(wire[5:7], "little") == len(wire) - 7
    assert crc16(wire[:-2]) == int.from_bytes(wire[-2:], "little")
    assert len(wire) == 10 + len(params) + params.count(b"\xff\xff\xfd")
    assert b"\xff\xff\xfd\x00" not in wire[4:-2]


@given(
    st.lists(st.tuples(st.integers(0, 252), payloads), max_size=6),
    st.lists(st.integers(1, 9), min_size=1, max_size=20),
)
def test_any_cutting_of_the_stream_gives_the_same_frames(messages, cuts):
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


@given(st.binary(max_size=80), st.integers(1, 20))
def test_garbage_never_costs_the_good_frames_behind_it(garbage, cut):
    """A believable broken length may make the parser wait: two frames of its size end that."""
    good = encode_status(5, 0, b"\x01\x02\x03\x04")
    parser = Parser()
    found = []
    stream = garbage + good
    for at in range(0, len(stream), cut):
        found += parser.feed(stream[at : at + cut])
    if found[-1:] != [Frame(5, Instruction.STATUS, 0, b"\x01\x02\x03\x04")]:
        for _ in range(MAX_LENGTH // len(good) + 2):
            found += parser.feed(good)
        assert found.count(Frame(5, Instruction.STATUS, 0, b"\x01\x02\x03\x04")) > 100


@given(st.data())
def test_frame_behind_a_damaged_one_is_found_at_once(data):
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


@given(st.lists(st.binary(max_size=50), max_size=40))
def test_no_bytes_make_it_raise_and_its_memory_is_bounded(chunks):
    parser = Parser(report_crc=True)
    for chunk in chunks:
        for frame in parser.feed(b"\xff\xff\xfd\x00" + chunk):
            assert frame.error == ErrorCode.CRC or frame.instruction == chunk[3]
        assert len(parser._buffer) <= MAX_LENGTH + 7


def test_corrupt_counts_each_broken_frame_and_each_run_of_garbage_once():
    good = encode_status(1, 0, b"xy")
    bad = bytearray(good)
    bad[-1] ^= 1
    parser = Parser()
    parser.feed(b"hello" + good + bytes(bad) + good + b"\x00" + b"\x01" + good)
    assert parser.corrupt == 3


def test_reset_forgets_half_a_frame():
    good = encode_status(1, 0, b"xy")
    parser = Parser()
    assert parser.feed(good[:6]) == []
    parser.reset()
    assert parser.feed(good) == [Frame(1, Instruction.STATUS, 0, b"xy")]
    assert parser.corrupt == 0


def test_wrong_crc_is_reported_where_asked_for():
    bad = bytearray(encode(7, Instruction.PING))
    bad[-1] ^= 0x40
    assert Parser().feed(bytes(bad)) == []
    assert Parser(report_crc=True).feed(bytes(bad)) == [
        Frame(7, Instruction.PING, ErrorCode.CRC, b"")
    ]


@given(st.lists(st.tuples(st.integers(0, 252), tricky), min_size=1, max_size=5))
def test_fast_sync_reply_is_not_stuffed(items):
    size = max(len(p) for _, p in items)
    shares = [FastReply(i, 0, p.ljust(size, b"\xff")) for i, p in items]
    wire = encode_fast_status(shares)
    assert len(wire) == 8 + len(shares) * (size + 4)
    (frame,) = Parser().feed(wire)
    assert decode_fast_status(frame, size) == shares


def test_fast_sync_reply_of_another_size_is_refused():
    (frame,) = Parser().feed(FAST_REPLY)
    assert decode_fast_status(frame, 5) == []
    (other,) = Parser().feed(encode_status(1, 0, b"\x00" * 5))
    assert decode_fast_status(other, 4) == []


@pytest.mark.parametrize("id_", [-1, 253, 255])
def test_impossible_id_is_refused(id_):
    with pytest.raises(ValueError, match=str(id_)):
        encode(id_, Instruction.PING)


@given(st.binary(min_size=20, max_size=20), st.integers(0, 255))
def test_the_expected_reply_is_known_without_a_search(data: bytes, error: int) -> None:
    expected = ExpectedReply(3, 20)
    reply = encode_status(3, error, data)
    (parsed,) = Parser().feed(reply)
    found = expected.match(reply)
    assert found == parsed or (found is None and len(reply) > 31), "a stuffed one is left to search"


def test_what_is_not_quite_the_expected_reply_is_left_to_the_parser() -> None:
    expected = ExpectedReply(3, 4)
    reply = encode_status(3, 0, b"abcd")
    assert expected.match(reply) is not None
    for other in (
        reply[:-1],
        reply + b"\0",
        encode_status(4, 0, b"abcd"),
        encode_status(3, 0, b"abcde"),
        encode(3, Instruction.READ, b"abcde"),
        *(reply[:at] + bytes((reply[at] ^ 1,)) + reply[at + 1 :] for at in range(len(reply))),
    ):
        assert expected.match(other) is None


def test_a_stuffed_reply_is_not_taken_for_the_longer_one_it_looks_like() -> None:
    """A late reply of 16 bytes, one stuffed in, is as long on the wire as one of 17."""
    late = encode_status(1, 0, b"\xff\xff\xfd" + bytes(13))
    assert len(late) == len(encode_status(1, 0, bytes(17)))
    assert ExpectedReply(1, 17).match(late) is None


def test_a_fast_reply_that_holds_a_header_arrives_in_pieces() -> None:
    """It is not stuffed, so that a header in it is data."""
    wire = encode_fast_status([FastReply(1, 0, b"\xff\xff\xfd\x00"), FastReply(2, 0, bytes(4))])
    parser = Parser()
    frames = [frame for byte in wire for frame in parser.feed(bytes([byte]))]
    assert [reply.data for reply in decode_fast_status(frames[0], 4)] == [
        b"\xff\xff\xfd\x00",
        bytes(4),
    ]
