"""Every fault as a client meets it, and the witness beside it, on the bus in memory."""

import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import BROADCAST, ErrorCode, Instruction, Parser, encode
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.faults import KINDS
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.errors import ServoLostError
from tests.cases import sampled
from tests.hw.dynamixel.emulated_client import BYTE_NS, MS, Client

X = "XM430-W350"
PING = encode(1, Instruction.PING)
READ_POSITION = bytes([132, 0, 4, 0])


CLEAN = Client().heard(PING)


# --- single frames ---------------------------------------------------------------------------


@pytest.mark.parametrize(("way", "heard"), [("reply", 1), ("request", 0)])
def test_every_hundredth_frame_is_lost_on_its_way(way: str, heard: int) -> None:
    client = Client()
    client.inject(f"drop:every=100,way={way}")
    before = len(client.rows())
    results = [bool(client.heard(PING)) for _ in range(300)]
    assert [n + 1 for n, ok in enumerate(results) if not ok] == [100, 200, 300]
    assert client.bus.faults == [(f"drop:every=100,way={way}", 3)]
    events = Counter(row[1] for row in client.rows()[before:])
    # What the servo heard and said: a lost reply was said, a lost request was not even heard.
    assert events["fault"] == 3
    assert events["rx"] == events["tx"] == 297 + 3 * heard


@pytest.mark.parametrize(
    ("spec", "seed"), sampled([("corrupt:p=0.1,way=reply", 2), ("drop:p=0.1,way=reply", 1)], 2)
)
def test_as_many_as_the_probability_says_and_the_same_every_time(spec: str, seed: int) -> None:
    def run(seed: int) -> tuple[list[bytes], str]:
        client = Client(faults=Faults((), seed))
        client.inject(spec)
        heard = [client.heard(PING) for _ in range(1000)]
        (_, struck), rows = client.bus.faults[0], client.fault_rows()
        assert sum(data != CLEAN for data in heard) == struck == len(rows)
        return heard, client.record.getvalue()

    first, record = run(seed)
    assert run(seed) == (first, record)
    assert run(seed + 1)[0] != first
    struck = sum(data != CLEAN for data in first)
    assert struck == pytest.approx(100, abs=5 * math.sqrt(1000 * 0.1 * 0.9))


def test_a_corrupt_request_is_refused_or_not_understood_and_never_acts() -> None:
    client = Client()
    client.inject("corrupt:way=request")
    write = encode(1, Instruction.WRITE, bytes([65, 0, 1]))  # LED
    errors = Counter(
        frame.error for _ in range(200) for frame in Parser().feed(client.heard(write, 500_000))
    )
    # A frame whose length or header was hit never ends for the servo, until the gap is too long.
    assert set(errors) == {ErrorCode.CRC}
    client.bus.lift("corrupt", client.clock.now_ns())
    client.pass_time(2 * MS)
    assert client.read(1, 65, 1) == 0


def test_truncate_keeps_the_beginning() -> None:
    client = Client()
    client.inject("truncate:way=reply")
    lengths = set()
    for _ in range(200):
        rest = client.heard(PING)
        assert CLEAN.startswith(rest)
        lengths.add(len(rest))
    assert lengths == set(range(1, len(CLEAN)))
    client.bus.lift("truncate", client.clock.now_ns())
    client.inject("truncate:keep=5,way=reply")
    assert client.heard(PING) == CLEAN[:5]


def test_a_copy_noise_and_another_id_are_what_their_names_say() -> None:
    client = Client()
    client.inject("duplicate:times=1,way=reply")
    assert [client.heard(PING), client.heard(PING)] == [CLEAN + CLEAN, CLEAN]
    client.inject("noise:bytes=20,times=1,way=reply")
    noisy = client.heard(PING)
    assert len(noisy) == 20 + len(CLEAN) and noisy.endswith(CLEAN)
    client.inject("wrong-id:to=9,way=reply")
    (frame,) = Parser().feed(client.heard(PING))
    assert frame.id == 9


@pytest.mark.parametrize("way", ["request", "reply"])
def test_late_by_so_much(way: str) -> None:
    client = Client()
    client.inject(f"late:ms=3,times=1,way={way}")
    start = client.clock.now_ns()
    client.line.write(PING)
    assert client.line.wait(start + 10 * MS)
    assert client.clock.now_ns() - start == 24 * BYTE_NS + 3 * MS
    assert client.line.read() == CLEAN
    left = float(next(row[0] for row in reversed(client.rows()) if row[1] == "tx")) * 1e9
    # A late reply left the servo in time; a late request came to it late.
    assert left - start == pytest.approx(24 * BYTE_NS + (3 * MS if way == "request" else 0), abs=1)


def test_faults_can_be_for_one_id_and_one_time_only() -> None:
    client = Client((X, 1), (X, 2))
    client.inject("drop:id=2,way=reply,at=0.1,for=0.2")
    start = client.clock.now_ns()
    outcome = []
    for tenth in range(4):
        client.pass_time(start + (100 * tenth + 50) * MS - client.clock.now_ns())
        outcome.append((bool(client.heard(PING)), bool(client.heard(encode(2, Instruction.PING)))))
    assert outcome == [(True, True), (True, False), (True, False), (True, True)]


# --- one servo of several --------------------------------------------------------------------


FAST_OF_THREE = encode(BROADCAST, Instruction.FAST_SYNC_READ, READ_POSITION + bytes([1, 2, 3]))
AHEAD, PART = 8, 8
"""Bytes of a joint reply before its parts, and of a part with 4 bytes of data"""


@pytest.fixture
def three() -> Client:
    return Client((X, 1), (X, 2), (X, 3))


def joint(client: Client) -> tuple[bytes, list[int]]:
    """The bytes of a joint reply, and the ids of its valid parts."""
    wire = client.heard(FAST_OF_THREE)
    return wire, [frame.id for frame in Parser(joint=3).feed(wire)]


@pytest.mark.parametrize(
    ("fault", "count", "ids"),
    [
        ("drop", AHEAD + PART, [1]),  # who comes after it waits for its part, in vain
        ("truncate:keep=3", AHEAD + PART + 3, [1]),
        ("corrupt:flips=2", AHEAD + 3 * PART, [1]),
        ("noise:bytes=5", AHEAD + 3 * PART + 5, [1]),
        ("duplicate", AHEAD + 4 * PART, [1, 2]),
        ("wrong-id:to=9", AHEAD + 3 * PART, [1, 9, 3]),
    ],
)
def test_a_fault_of_one_servo_strikes_its_part_of_a_joint_reply(
    three: Client, fault: str, count: int, ids: list[int]
) -> None:
    clean, all_three = joint(three)
    assert all_three == [1, 2, 3]
    name, _, rest = fault.partition(":")
    three.inject(f"{name}:id=2,way=reply,times=1,{rest}".rstrip(","))
    wire, found = joint(three)
    assert (len(wire), found) == (count, ids)
    assert wire.startswith(clean[: AHEAD + PART])
    assert [row[1:] for row in three.fault_rows()] == [(2, name)]
    assert joint(three) == (clean, [1, 2, 3])


def test_a_late_part_holds_up_the_parts_after_it(three: Client) -> None:
    three.inject("late:id=2,ms=1,way=reply")
    start = three.clock.now_ns()
    three.line.write(FAST_OF_THREE)
    heard = []
    while three.line.wait(three.clock.now_ns() + 3 * MS):
        heard.append((three.clock.now_ns() - start, len(three.line.read())))
    first_ns = (len(FAST_OF_THREE) + AHEAD + PART) * BYTE_NS
    assert heard == [(first_ns, AHEAD + PART), (first_ns + MS + 2 * PART * BYTE_NS, 2 * PART)]


@pytest.mark.parametrize(
    ("fault", "deaf"),
    [("drop", True), ("corrupt", True), ("truncate", True), ("wrong-id", True), ("noise", False)],
)
def test_a_fault_of_one_servo_keeps_a_joint_instruction_from_it_alone(
    three: Client, fault: str, deaf: bool
) -> None:
    three.inject(f"{fault}:id=2,way=request")
    three.sync_write(65, 1, {1: 1, 2: 1, 3: 1})  # LED
    three.pass_time(MS)
    assert [three.servos[id_].memory["led"] for id_ in (1, 2, 3)] == [1, 1 - deaf, 1]
    assert [row[1:] for row in three.fault_rows()] == [(2, fault)] * deaf


@pytest.mark.parametrize("fault", ["brown-out", "unplug"])
def test_a_servo_that_loses_its_power_breaks_a_joint_reply_off(fault: str) -> None:
    for byte, count in ((1, AHEAD + PART), (AHEAD + PART + 3, AHEAD + PART + 3)):
        client = Client((X, 1), (X, 2), (X, 3))
        client.line.write(FAST_OF_THREE)
        client.pass_time((len(FAST_OF_THREE) + byte) * BYTE_NS)
        client.inject(f"{fault}:id=2")
        wire = b""
        while client.line.wait(client.clock.now_ns() + 3 * MS):
            wire += client.line.read()
        assert len(wire) == count


# --- servos ----------------------------------------------------------------------------------


def position(client: Client, id_: int = 1) -> int:
    return client.read(id_, 132, 4, signed=True)


def test_a_stuck_encoder_stands_while_the_shaft_turns() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, 102, 200, 2)
    client.pass_time(20 * MS)
    client.inject("stuck:for=0.05")
    stuck_at = position(client)
    client.pass_time(30 * MS)
    true = client.position() * 4096 / (2 * math.pi)
    assert position(client) == stuck_at < true - 10
    assert client.read(1, 128, 4, signed=True) == 0  # the velocity is taken from it
    client.pass_time(30 * MS)
    assert abs(position(client) - client.position() * 4096 / (2 * math.pi)) < 1.5
    assert client.read(1, 128, 4, signed=True) > 0
    assert [name for _, _, name in client.fault_rows()] == ["stuck", "stuck over"]


def test_a_hardware_error_shows_alerts_and_shuts_down_as_configured() -> None:
    client = Client((X, 1), (X, 2))
    for id_ in (1, 2):
        client.enable_current_mode(id_)
        client.write(id_, 102, 100, 2)
    start = client.clock.now_ns()
    client.inject("hardware-error:bits=overload,at=0.03,id=1")
    client.pass_time(29 * MS)
    assert client.torque() > 0
    client.pass_time(2 * MS)
    reply = client.answer(1, Instruction.READ, bytes([70, 0, 1, 0]))
    assert reply.error == 0x80
    assert reply.params == b"\x20"
    assert client.torque() == 0
    assert client.torque(2) > 0
    off = next(
        r
        for r in client.rows()
        if r[1] == "state" and r[2] == "1" and float(r[6]) == 0 and float(r[0]) * 1e9 > start
    )
    assert float(off[0]) * 1e9 - start == pytest.approx(30 * MS, abs=MS)
    ((time_s, id_, name),) = client.fault_rows()
    assert (id_, name) == (1, "hardware-error")
    assert float(time_s) * 1e9 - start == pytest.approx(30 * MS, abs=1)
    client.ask(1, Instruction.REBOOT)
    client.pass_time(300 * MS)
    assert client.answer(1, Instruction.READ, bytes([70, 0, 1, 0])).error == 0


def test_a_supply_that_sags_and_recovers_leaves_its_error_latched() -> None:
    client = Client()
    client.inject("supply:volts=9,at=0.1,for=0.05")
    client.pass_time(99 * MS)
    assert (client.read(1, 144, 2), client.read(1, 70, 1)) == (120, 0)
    client.pass_time(5 * MS)
    assert (client.read(1, 144, 2), client.read(1, 70, 1)) == (90, 0x01)
    client.pass_time(50 * MS)
    assert (client.read(1, 144, 2), client.read(1, 70, 1)) == (120, 0x01)
    assert [name for _, _, name in client.fault_rows()] == ["supply", "supply over"]


def test_one_servo_stands_in_the_heat_until_that_is_lifted() -> None:
    client = Client((X, 1), (X, 2))
    client.enable_current_mode(2)
    client.write(2, 102, 100, 2)
    client.inject("ambient:celsius=85,id=2")
    assert [client.read(i, 146, 1) for i in (1, 2)] == [32, 85]
    assert [client.read(i, 70, 1) for i in (1, 2)] == [0, 0x04]
    assert client.torque(2) == 0  # overheating is in Shutdown
    assert client.bus.lift("ambient", client.clock.now_ns())
    client.ask(2, Instruction.REBOOT)
    client.pass_time(500 * MS)
    assert (client.read(2, 146, 1), client.read(2, 70, 1)) == (32, 0)


@pytest.mark.parametrize("spec", ["unplug:at=0.01,for=0.5", "unplug:at=0.01,for=0.5,id=1"])
def test_a_servo_off_the_cable_is_limp_and_silent_and_comes_back_as_from_power_up(
    spec: str,
) -> None:
    client = Client((X, 1), (X, 2))
    client.enable_current_mode()
    client.write(1, 60, 1, 1)
    client.write(1, 102, 100, 2)
    client.inject(spec)
    client.pass_time(11 * MS)
    assert client.torque() == 0
    assert client.ask(1, Instruction.PING) is None
    assert (client.ask(2, Instruction.PING) is None) == ("id" not in spec)
    client.inject("brown-out")  # no power, no brown-out
    client.inject("hardware-error:bits=overload")
    client.pass_time(400 * MS)
    assert client.ask(1, Instruction.PING) is None
    client.pass_time(310 * MS)
    assert client.answer(1, Instruction.PING).error == 0
    assert client.read(1, 64, 1) == 0


def test_an_unplugged_adapter_ends_the_line_and_a_new_one_finds_the_servos_going_on() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, 102, 100, 2)
    client.inject("unplug-adapter:at=0.001,for=0.01")
    client.line.write(PING)
    with pytest.raises(ServoLostError, match="unplugged"):
        client.line.wait(client.clock.now_ns() + 100 * MS) and client.line.read()
        client.line.wait(client.clock.now_ns() + 100 * MS)
    assert client.torque() > 0  # the servos have not noticed
    client.pass_time(20 * MS)
    with pytest.raises(ServoLostError):
        client.line.write(PING)
    client.line = MemoryLine(client.bus, client.clock)
    assert client.heard(PING) == CLEAN
    assert [(i, name) for _, i, name in client.fault_rows()] == [
        (254, "unplug-adapter"),
        (254, "unplug-adapter over"),
    ]


# --- the record ------------------------------------------------------------------------------


STEADY = [
    "drop:p=0.3",
    "corrupt:p=0.3,flips=9",
    "truncate:p=0.3",
    "duplicate:p=0.3",
    "late:ms=2.7,p=0.3",
    "wrong-id:p=0.3",
    "noise:p=0.3,bytes=40",
    "stuck:for=0.003,repeat=0.007",
    "jump:counts=-77,repeat=0.003",
    "hardware-error:bits=overload,repeat=0.05",
    "supply:volts=2,for=0.01,repeat=0.03",
    "ambient:celsius=150,for=0.01,repeat=0.03",
    "brown-out:repeat=0.3",
    "unplug:for=0.02,repeat=0.25",
    "unplug-adapter:for=0.01,repeat=0.1",
]


@given(
    st.lists(st.sampled_from(STEADY), max_size=6),
    st.sampled_from([None, (1, 62), (16, 510)]),
    st.integers(0, 1000),
)
def test_any_faults_together_break_nothing_and_are_over_when_lifted(
    specs: list[str], timer: tuple[int, int] | None, seed: int
) -> None:
    adapter = None if timer is None else Adapter(timer[0] * MS, timer[1], 5 * MS)
    client = Client((X, 1), (X, 2), fast=False, adapter=adapter, faults=Faults(specs, seed))
    requests = [
        PING,
        encode(2, Instruction.READ, bytes([120, 0, 40, 0])),
        encode(BROADCAST, Instruction.FAST_SYNC_READ, READ_POSITION + bytes([1, 2])),
        encode(BROADCAST, Instruction.SYNC_WRITE, bytes([65, 0, 1, 0, 1, 1])),
    ]
    for n in range(60):
        try:
            client.line.write(requests[n % 4])
            client.line.wait(client.clock.now_ns() + 2 * MS)
            client.line.read()
        except ServoLostError:
            client.pass_time(MS)
            client.line = MemoryLine(client.bus, client.clock)
    for name in KINDS:
        client.bus.lift(name, client.clock.now_ns())
    assert client.bus.faults == []
    client.pass_time(500 * MS)  # booted, and what was held up has come
    client.line = MemoryLine(client.bus, client.clock)
    client.line.read()
    assert Parser().feed(client.heard(PING, 20 * MS))[-1].params == bytes([0xFC, 0x03, 48])
    times = [float(row[0]) for row in client.rows()]
    assert times == sorted(times)
    assert {float(row[4]) for row in client.rows()} == {1.0}
