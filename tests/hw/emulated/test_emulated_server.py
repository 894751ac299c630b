"""The real process on a pseudo-terminal, driven by an independent client: the vendor's SDK."""

import csv
import json
import os
import select
import signal
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import dynamixel_sdk
import pytest
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from haptic_wall.controller.emulated_bus.bus import PROGRAM
from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode
from haptic_wall.hw.dynamixel.codec.frames import Frame
from tests.typed import not_none

pytestmark = pytest.mark.realtime

BAUD = 4_000_000
WAIT_S = 20.0
"""Generous: a loaded machine may take seconds to start a process"""
PING = encode(1, Instruction.PING)


@contextmanager
def emulate(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command in a process of its own; its terminal's path."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "haptic_wall.controller.cli.main",
            "emulate",
            *arguments,
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        ready, _, _ = select.select([not_none(process.stdout)], [], [], WAIT_S)
        assert ready, "the emulated bus did not start"
        yield process, not_none(process.stdout).readline().strip()
    finally:
        process.terminate()
        process.wait(WAIT_S)
        not_none(process.stdout).close()
        not_none(process.stdin).close()


class PatientPort(dynamixel_sdk.PortHandler):  # type: ignore[misc]
    """The SDK gives a reply 34 ms; a busy test machine may need more."""

    patience_ms = 2_000

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802, ARG002
        self.setPacketTimeoutMillis(self.patience_ms)


@contextmanager
def sdk(path: str, baud: int = BAUD) -> Iterator[tuple[PatientPort, Protocol2PacketHandler]]:
    port = PatientPort(path)
    port.baudrate = baud
    assert port.openPort()
    try:
        yield port, dynamixel_sdk.PacketHandler(2.0)
    finally:
        port.closePort()


def ask(descriptor: int, frame: bytes, within_s: float) -> Frame | None:
    """The first reply that comes in time."""
    parser = Parser()
    os.write(descriptor, frame)
    deadline = time.monotonic() + within_s
    while (left := deadline - time.monotonic()) > 0:
        if select.select([descriptor], [], [], left)[0]:
            frames = parser.feed(os.read(descriptor, 1000))
            if frames:
                return frames[0]
    return None


def test_terminal_is_raw_and_clients_come_and_go_at_their_speed() -> None:
    with emulate("--baud", "1e6") as (process, path):
        every_byte = bytes(range(256))
        for _ in range(2):
            terminal = os.open(path, os.O_RDWR | os.O_NOCTTY)
            try:
                flags = termios.tcgetattr(terminal)
                assert not flags[3] & (termios.ECHO | termios.ICANON | termios.ISIG)
                assert ask(terminal, every_byte + PING, WAIT_S) is not None
            finally:
                os.close(terminal)
        with sdk(path, 57_600) as (port, sdk2):
            port.patience_ms = 100
            assert sdk2.ping(port, 1)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
        with sdk(path, 1_000_000) as (port, sdk2):
            assert sdk2.ping(port, 1) == (1020, 0, 0)
        process.send_signal(signal.SIGHUP)
        assert process.wait(WAIT_S) == 0


def tell(process: subprocess.Popen[str], line: str) -> str:
    """Say it on standard input; what is said on standard output when it is done."""
    not_none(process.stdin).write(line + "\n")
    not_none(process.stdin).flush()
    ready, _, _ = select.select([not_none(process.stdout)], [], [], WAIT_S)
    assert ready
    return not_none(process.stdout).readline().strip()


def test_the_vendors_sdk_meets_faults_given_at_start_and_while_it_runs(tmp_path: Path) -> None:
    """Each as its own result: nothing came, what came was broken, somebody else answered."""
    record = tmp_path / "record.csv"
    given = ("--fault", "drop:way=reply,every=5", "--seed", "7", "--record", str(record))
    with emulate(*given) as (process, path), sdk(path) as (port, sdk2):
        timeout, ok = dynamixel_sdk.COMM_RX_TIMEOUT, dynamixel_sdk.COMM_SUCCESS
        # On one busy core a reply just after the opening has been lost, so the count begins anew.
        assert ok in (sdk2.ping(port, 1)[1] for _ in range(3))
        assert tell(process, "list").startswith("drop:way=reply,every=5 (happened: ")
        assert tell(process, "off drop") == "off drop"
        assert tell(process, "drop:way=reply,every=5") == "on drop:way=reply,every=5"
        results = []
        for ping in range(10):
            dropped = ping % 5 == 4
            port.patience_ms = 200 if dropped else PatientPort.patience_ms
            results.append(sdk2.ping(port, 1)[1])
        port.patience_ms = 200
        assert results == ([ok] * 4 + [timeout]) * 2
        assert tell(process, "list") == "drop:way=reply,every=5 (happened: 2)"
        assert tell(process, "off drop") == "off drop"
        assert tell(process, "corrupt:flips=1,way=reply") == "on corrupt:flips=1,way=reply"
        broken = {sdk2.ping(port, 1)[1] for _ in range(5)}
        assert broken <= {dynamixel_sdk.COMM_RX_CORRUPT, timeout}
        assert tell(process, "off corrupt") == "off corrupt"
        assert tell(process, "wrong-id:to=9,way=reply") == "on wrong-id:to=9,way=reply"
        assert sdk2.ping(port, 1)[1] == timeout  # it goes on looking for its own
        assert tell(process, "off wrong-id") == "off wrong-id"
        port.patience_ms = PatientPort.patience_ms
        assert tell(process, "hardware-error:bits=overload").startswith("on")
        _, result, error = sdk2.read1ByteTxRx(port, 1, 70)
        assert (result, error) == (ok, 0x80)
        assert sdk2.ping(port, 1) == (1020, ok, 0x80)
    with record.open(encoding="utf-8") as file:
        faults = [row["fault"] for row in csv.DictReader(file) if row["event"] == "fault"]
    assert faults == ["drop"] * 2 + ["corrupt"] * 5 + ["wrong-id", "hardware-error"]


def test_an_unplugged_adapter_hangs_up_and_the_link_leads_to_the_new_one(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    with emulate("--link", str(link)) as (process, path):
        terminal = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(terminal)
        assert ask(terminal, PING, WAIT_S) is not None
        assert tell(process, "unplug-adapter:for=0.2").startswith("on")
        hung_up = select.poll()
        hung_up.register(terminal, 0)
        assert hung_up.poll(WAIT_S * 1e3)[0][1] & select.POLLHUP
        new_path = not_none(process.stdout).readline().strip()
        assert str(link.readlink()) == new_path
        again = os.open(link, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(again)
        assert ask(again, PING, WAIT_S) is not None
        os.close(again)
        os.close(terminal)
    assert not os.path.lexists(link)


def test_it_dies_with_its_parent(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    plan = json.dumps({"servos": ["XM430-W350"], "link": str(link)})
    arguments = [sys.executable, "-m", PROGRAM, plan]
    parent = (
        "import subprocess, sys; "
        "child = subprocess.Popen(sys.argv[1:]); print(child.pid, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", parent, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert not_none(process.stdout).readline().strip().isdecimal()
        assert not_none(process.stdout).readline().startswith("/dev/pts/")
        assert link.is_symlink()
        process.kill()
    deadline = time.monotonic() + WAIT_S
    while os.path.lexists(link) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not os.path.lexists(link)
