"""Looking at a bus without driving it: who answers, what is wrong, mending, and reply times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pytest

from haptic_wall.controller.doctor import adapter as adapters
from haptic_wall.controller.doctor.mending import mend
from haptic_wall.controller.doctor.replies import time_replies
from haptic_wall.controller.doctor.report import Change
from haptic_wall.controller.doctor.search import search
from haptic_wall.controller.doctor.timing import sustainable_hz
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser
from haptic_wall.hw.dynamixel.codec.frames import Frame
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.rules import Rule, judge, read_servo
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import PortError
from haptic_wall.hw.servo import Check
from haptic_wall.hw.truth import TrueServo

MS = 1_000_000
BAUD = 4_000_000
TORQUE_ENABLE = 64
WRITING = {Instruction.WRITE, Instruction.SYNC_WRITE}


class Bus:
    """Servos in memory, (model, id) each, and every frame that was sent to them."""

    def __init__(
        self,
        *servos: tuple[str, int],
        baud: int = BAUD,
        timer_ns: int = 0,
        phase_ns: int = 0,
        return_delay: int | None = None,
    ) -> None:
        self.clock = SimulatedClock(7 * MS)
        now = self.clock.now_ns()
        self.servos = {
            i: EmulatedServo(MODELS[m], i, 48, TrueServo(0.01), start_ns=now, baud=baud)
            for m, i in servos or (("XM430-W350", 1),)
        }
        adapter = Adapter(timer_ns, 510, now + phase_ns) if timer_ns else None
        bus = EmulatedBus(list(self.servos.values()), baud=BAUD, start_ns=now, adapter=adapter)
        self._line = MemoryLine(bus, self.clock)
        self.sent: list[Frame] = []
        if return_delay is not None:
            self.set(return_delay_time=return_delay)

    def write(self, data: bytes) -> None:
        self.sent += Parser().feed(data)
        self._line.write(data)

    def read(self) -> bytes:
        return self._line.read()

    def wait(self, deadline_ns: int) -> bool:
        return self._line.wait(deadline_ns)

    def close(self) -> None:
        pass

    @cached_property
    def table(self) -> Table:
        return Table.on(self, BAUD, 1, "memory", MODELS["XM430-W350"])

    def set(self, **values: int) -> None:
        """Set registers as another client would have."""
        table = self.table
        for name, value in values.items():
            table.write(name, value)
        self.sent.clear()

    def judged(self, torque_limit: float = 4.0) -> dict[str, tuple[Rule, Check]]:
        seen = read_servo(self.table, MODELS["XM430-W350"], 4.1 / 2.3, torque_limit)
        return {check.name: (rule, check) for rule, check in judge(seen)}

    def wrong(self) -> list[str]:
        return [name for name, (_, check) in self.judged().items() if not check.ok]

    def check(self, name: str) -> Check:
        return self.judged()[name][1]

    def mend(self, name: str) -> Change:
        rule, _ = self.judged()[name]
        return mend(self.table, self.clock, name, rule)

    def mend_all(self) -> list[Change]:
        """Mend what is wrong, in the order of the table, but reboot last."""
        wrong = [(check.name, rule) for rule, check in self.judged().values() if not check.ok]
        order = sorted(wrong, key=lambda each: not each[1].register)
        return [mend(self.table, self.clock, name, rule) for name, rule in order]

    def wrote(self) -> list[Frame]:
        return [f for f in self.sent if f.instruction in WRITING]


def test_everybody_on_the_bus_is_found_with_model_and_firmware() -> None:
    bus = Bus(("XM430-W350", 3), ("XL330-M288", 1), ("XH430-W350", 200))
    found = search(bus, BAUD)
    assert [(s.id, s.model, s.firmware) for s in found.servos] == [
        (1, "XL330-M288", 48),
        (3, "XM430-W350", 48),
        (200, "XH430-W350", 48),
    ]
    assert found.garbled == 0
    assert [s.id for s in search(Bus(("XM430-W350", 200)), BAUD).servos] == [200], "and one alone"


def test_a_servo_at_another_rate_is_silence_and_costs_little_time() -> None:
    bus = Bus(baud=57600)
    begun = bus.clock.now_ns()
    found = search(bus, BAUD)
    assert found.servos == []
    assert found.garbled == 0
    # 253 slots of 3 ms, 21 pings of 2.5 ms, and twice what an adapter may hold
    assert bus.clock.now_ns() - begun < 900 * MS


@dataclass
class Fault:
    register: str
    value: int
    name: str
    found: str
    mended: str


FAULTS = [
    Fault("return_delay_time", 250, "return delay", "250", "0"),
    Fault("drive_mode", 9, "drive mode", "reverse and torque on by goal update", "normal"),
    Fault("startup_configuration", 1, "start-up configuration", "torque on at power-up", "0"),
    Fault("startup_configuration", 2, "start-up configuration", "old goals restored", "0"),
    Fault("secondary_id", 9, "secondary id", "9", "none"),
    Fault("shutdown", 52 - 4, "shutdown", "48, without overheating", "52"),
    Fault("torque_enable", 1, "torque", "on", "off"),
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.name}-{fault.value}")
def test_what_hurts_is_found_and_mended_and_nothing_else_is_touched(fault: Fault) -> None:
    bus = Bus(return_delay=0)
    bus.set(**{fault.register: fault.value})
    assert bus.wrong() == [fault.name]
    assert bus.check(fault.name).found == fault.found
    assert bus.wrote() == []
    assert bus.mend(fault.name).verified
    assert [frame.params[0] for frame in bus.wrote()] == [
        MODELS["XM430-W350"].registers[fault.register].address
    ]
    assert bus.check(fault.name).found == fault.mended
    assert bus.wrong() == []


def test_a_latched_error_is_named_and_a_reboot_clears_what_has_no_cause_any_more() -> None:
    bus = Bus()
    bus.set(max_voltage_limit=110)  # the emulated supply gives 12 V
    bus.wait(bus.clock.now_ns() + 10 * MS)
    assert bus.check("hardware error").found == "input voltage (0x01)"
    assert not bus.check("supply").ok
    assert not bus.mend("hardware error").verified  # it is still there
    bus.set(max_voltage_limit=160)
    assert bus.mend("hardware error").verified
    assert bus.check("hardware error").ok


@pytest.mark.parametrize("startup", [1, 2])
def test_a_servo_that_may_start_with_torque_is_not_rebooted_until_that_is_mended(
    startup: int,
) -> None:
    bus = Bus(return_delay=0)
    bus.set(startup_configuration=startup)
    bus.servos[1].latch_errors(0x20, bus.clock.now_ns())
    change = bus.mend("hardware error")
    assert not change.verified
    assert "Startup Configuration (60)" in change.after
    assert Instruction.REBOOT not in {frame.instruction for frame in bus.sent}
    assert all(change.verified for change in bus.mend_all())
    assert bus.wrong() == []


def test_torque_is_never_enabled_by_any_repair() -> None:
    bus = Bus()
    bus.set(drive_mode=9, startup_configuration=3, secondary_id=4, shutdown=0, torque_enable=1)
    assert all(change.verified for change in bus.mend_all())
    enabled = [f for f in bus.wrote() if f.params[0] == TORQUE_ENABLE and f.params[5] != 0]
    assert enabled == []
    assert not bus.table.read("torque_enable")


def test_too_low_a_current_limit_is_advice_and_none_at_all_or_an_impossible_one_is_wrong() -> None:
    bus = Bus()
    bus.set(current_limit=100)
    low = bus.check("current limit")
    assert low.ok
    assert "0.48 N·m" in low.found
    assert "servo.torque_limit" in low.fix
    bus.set(current_limit=0)
    assert not bus.check("current limit").ok
    bus.servos[1].memory["current_limit"] = 1194
    found = bus.check("current limit")
    assert not found.ok
    assert "at most 1193" in found.fix
    assert "replace the servo" in found.fix


# Time


def test_without_an_adapter_a_reply_takes_its_time_on_the_wire_at_every_phase() -> None:
    bus = Bus(return_delay=0)
    replies = time_replies(bus, [1], 50, MS)
    # 14 bytes there, 27 or 28 back, 2.5 µs each
    assert 102_500 <= replies.took_ns[0] <= replies.took_ns[-1] <= 105_000


def test_an_adapter_timer_of_1_ms_spoils_immediate_and_leaves_pipelined() -> None:
    found = time_replies(Bus(timer_ns=MS, return_delay=0), [1], 200, MS)
    # A reply is ready 0.1 ms after its request and is given up 0.8 ms after: the timer expires in
    # that time at 7 of 10 phases, and a reply of the other 3 is lost every time.
    late = sum(took > 0.8 * MS for took in found.took_ns)
    assert late == pytest.approx(0.3 * 200, abs=3)
    assert found.took_ns[-1] < 1.11 * MS
    rates = sustainable_hz(found, BAUD, 0.05)
    assert 500 < rates["immediate"] < 1000 < rates["pipelined"]


def test_a_servo_that_is_silent_is_not_asked_for_ever() -> None:
    bus = Bus(return_delay=0)
    bus.servos[1].unplug(bus.clock.now_ns())
    found = time_replies(bus, [1], 20, MS)
    assert found.took_ns == []
    assert (found.asked, found.lost) == (20, 20)
    assert found.share_failed == 1


# Adapters


def test_the_only_adapter_is_taken_and_several_are_listed() -> None:
    first = adapters.Adapter("/dev/ttyUSB0", "FTDI")
    assert adapters.only_adapter([first]) == "/dev/ttyUSB0"
    with pytest.raises(PortError, match=r"--port.*ttyUSB0: FTDI; /dev/ttyACM0: ROBOTIS"):
        adapters.only_adapter([first, adapters.Adapter("/dev/ttyACM0", "ROBOTIS")])
    with pytest.raises(PortError, match="No USB serial adapter"):
        adapters.only_adapter([])


@pytest.mark.parametrize(
    ("text", "ok", "words"),
    [
        ("16", False, ["16 ms", "echo 1 | sudo tee"]),
        ("1", True, ["1 ms"]),
        (None, True, ["does not apply"]),
    ],
)
def test_the_latency_timer_is_judged_where_there_is_one(
    tmp_path: Path, text: str | None, ok: bool, words: list[str]
) -> None:
    timer = tmp_path / "ttyUSB9" / "device" / "latency_timer"
    if text is not None:
        timer.parent.mkdir(parents=True)
        timer.write_text(text)
    finding = adapters.examine_latency_timer("/dev/ttyUSB9", tmp_path)
    assert finding.ok is ok
    for word in words:
        assert word in f"{finding.found} {finding.fix}"
