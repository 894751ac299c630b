"""Real processes, a real pseudo-terminal: however a run ends, the torque is off and it is said.

Nothing here asserts how quick anything was: the machine may stall for longer than any limit
worth testing. The settings make the program patient, and the witness tells what happened.
"""

import contextlib
import csv
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_WARM_UP, ROW, Telemetry, Word
from tests.cases import sampled
from tests.support.program import PROGRAM, Cli, children, python, started, wait_for
from tests.typed import not_none

PATIENT = [
    word
    for setting in (
        "servo.watchdog_s=2.5",
        "safety.heartbeat_s=5",
        "safety.max_loss=1",
        "safety.max_silence_s=0.9",
        "realtime.profile=best-effort",
        "loop.warm_up_s=0.1",
    )
    for word in ("--set", setting)
]
BELIEF = ["--set", "wall.side=both", "--set", "wall.position=3.14159", "--set", "model.delay=0"]

pytestmark = pytest.mark.realtime


@contextlib.contextmanager
def emulator(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with started("emulate", "--record", "witness.csv", *arguments, cwd=folder) as process:
        yield process, not_none(process.stdout).readline().strip()


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


STALLED = {
    Trip.LOSSES_IN_ROW,
    Trip.LOSS_RATE,
    Trip.MISSED_PERIODS,
    Trip.LOOP_HUNG,
    Trip.TORQUE_LOST,
}
"""Trips of a loop that gets no processor time"""


def spoiled(process: subprocess.Popen[str], output: str) -> bool:
    """Whether a stalled machine has ended the run, in its start or by a trip."""
    return process.returncode == 4 or json.loads(output)["stop_reason"] in STALLED


@contextlib.contextmanager
def ticking(*arguments: str, cwd: Path) -> Iterator[tuple[subprocess.Popen[str], dict[str, int]]]:
    """A run whose log holds more rows than the warm-up has, the wall is on; and its family.

    A run that a stalled machine has spoiled is tried again; one that ends otherwise fails at once.
    """
    path = cwd / "run.hwlog"
    enough = 300 * ROW.itemsize

    def grown() -> bool:
        return path.exists() and path.stat().st_size > enough

    for attempt in range(5):
        path.unlink(missing_ok=True)
        with started(*arguments, cwd=cwd) as process:
            wait_for(lambda: grown() or process.poll() is not None, "a growing log")
            if process.poll() is None:
                yield process, children(process.pid)
                return
            output, said = process.communicate()
        assert spoiled(process, output) and attempt < 4, f"{process.returncode}: {said}"


def shared_words(pid: int) -> memoryview:
    """The control words of the telemetry that a process holds."""
    return Telemetry.of(pid).words


def run_arguments(*more: str, servo: str = "emulated-ideal") -> list[str]:
    picture = () if "--plot" in more else ("--no-plot",)  # it takes most of a second
    return ["run", servo, "--log", "run.hwlog", *picture, "--json", *PATIENT, *more]


@pytest.fixture
def servo(wholly: bool) -> str:
    """The servo of a run whose bus nobody looks at: one without a bus is quicker."""
    return "emulated-ideal" if wholly else "simulated"


def witness(folder: Path) -> list[dict[str, str]]:
    with (folder / "witness.csv").open() as file:
        return list(csv.DictReader(file))


OFF = "400001000100"
"""A sync write of one byte to Torque Enable of servo 1: 0"""


OFF_2 = f"{OFF}0200"
"""The same of servos 1 and 2"""


def assert_torque_off(rows: list[dict[str, str]], off: str = OFF) -> None:
    """The last the bus saw of torque: switched off, read back as off, and none acting."""
    torque_enable = [
        row
        for row in rows
        if row["event"] == "rx"
        and row["instruction"] in ("3", "131")
        and row["params"][:4] == "4000"
    ]
    assert torque_enable[-1]["params"] == off
    assert float(rows[-1]["torque_nm"]) == 0.0
    reads = [row for row in rows if row["event"] == "rx" and row["instruction"] == "2"]
    assert reads[-1]["params"][:4] == "4000", "read back, alone or with what follows it"
    assert [row for row in rows if row["event"] == "tx"][-1]["params"][:2] == "00"


def test_ctrl_c_twice_ends_the_run_with_torque_off_and_a_report(
    tmp_path: Path, wholly: bool
) -> None:
    picture = ("--plot", "run.png") if wholly else ()
    arguments = run_arguments("--duration", "60", "--witness", "witness.csv", *picture)
    with ticking(*arguments, cwd=tmp_path) as (process, _):
        process.send_signal(signal.SIGINT)
        time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    report = json.loads(output)
    assert report["stop_reason"] == "interrupted"
    assert report["torque_off"] is True
    assert report["ticks"] > 0
    assert not wholly or (tmp_path / "run.png").stat().st_size > 10_000
    assert_torque_off(witness(tmp_path))


@pytest.mark.whole
def test_a_run_outlives_a_killed_recorder_and_a_stopped_supervisor_until_sigterm(
    tmp_path: Path, servo: str
) -> None:
    arguments = run_arguments("--duration", "60", servo=servo)
    with ticking(*arguments, cwd=tmp_path) as (process, family):
        words = shared_words(family["loop_process"])
        os.kill(family["recorder"], signal.SIGKILL)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.3)  # the loop's heartbeat goes on unseen
        before = words[Word.TAIL]
        process.send_signal(signal.SIGCONT)
        wait_for(lambda: words[Word.TAIL] > before, "another recorder")
        process.send_signal(signal.SIGTERM)
        output, said = process.communicate(timeout=60)
    assert process.returncode == 130
    report = json.loads(output)
    assert report["stop_reason"] == "interrupted"
    assert "the recorder was killed by SIGKILL; another one continues the log" in said
    assert any("no row is missing from the log" in text for text in report["warnings"])
    rows = LogReader.open(tmp_path / "run.hwlog").rows()["seq"]
    assert list(rows) == list(range(words[Word.HEAD]))


@pytest.mark.parametrize(
    "axes",
    ["", pytest.param("{one: {servo: {id: 1}}, two: {servo: {id: 2}}}", marks=pytest.mark.whole)],
)
def test_a_killed_loop_has_its_torque_cut(tmp_path: Path, axes: str) -> None:
    sets = [f"--set=axes={axes}"] if axes else []
    arguments = run_arguments("--duration", "60", "--witness", "witness.csv", *sets)
    with ticking(*arguments, cwd=tmp_path) as (process, family):
        os.kill(family["loop_process"], signal.SIGKILL)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 3
    report = json.loads(output)
    assert report["stop_reason"] == "trip:loop_died"
    assert "was killed by SIGKILL" in report["explanation"]
    assert "switched the torque off and read it back" in report["explanation"]
    assert report["torque_off"] is True
    rows = witness(tmp_path)
    assert_torque_off(rows, OFF_2 if axes else OFF)
    ends = {row["id"]: float(row["torque_nm"]) for row in rows if row["event"] == "state"}
    assert ends == dict.fromkeys(("1", "2") if axes else ("1",), 0.0)


@pytest.mark.whole
def test_a_stopped_loop_has_its_torque_cut_and_says_nothing_when_resumed(tmp_path: Path) -> None:
    arguments = run_arguments("--duration", "60", "--witness", "witness.csv")
    arguments += ["--set", "safety.heartbeat_s=0.5"]
    with ticking(*arguments, cwd=tmp_path) as (process, family):
        loop = family["loop_process"]
        words = shared_words(loop)
        os.kill(loop, signal.SIGSTOP)
        wait_for(lambda: words[Word.CUT], "the supervisor's cut")
        with contextlib.suppress(ProcessLookupError):
            os.kill(loop, signal.SIGCONT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 3
    report = json.loads(output)
    assert report["stop_reason"] == "trip:loop_hung"
    assert "stopped by a signal" in report["explanation"]
    assert report["torque_off"] is True
    rows = witness(tmp_path)
    assert_torque_off(rows)
    asked = [row for row in rows if row["event"] == "rx"]
    cut = next(i for i, row in enumerate(asked) if row["params"] == OFF)
    after = asked[cut:]
    assert all(row["instruction"] == "2" or row["params"] == OFF for row in after), "no goal"


@pytest.mark.whole
def test_a_hung_start_ends_with_ctrl_c_and_torque_off(tmp_path: Path) -> None:
    arguments = run_arguments("--duration", "60", "--witness", "witness.csv")
    with started(*arguments, cwd=tmp_path) as process:
        loop = wait_for(lambda: children(process.pid).get("loop_process"), "the loop's process")
        os.kill(loop, signal.SIGSTOP)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(output)["stop_reason"] == "interrupted"
    assert gone(loop)
    assert_torque_off(witness(tmp_path))


def test_a_killed_supervisor_leaves_no_torque_and_no_process(tmp_path: Path) -> None:
    with emulator(tmp_path) as (bus, port):
        arguments = ["run", *on(port), "--log", "run.hwlog", "--no-plot", "--json"]
        with ticking(*arguments, cwd=tmp_path) as (process, family):
            assert set(family) == {"door", "loop_process", "recorder"}
            words = shared_words(family["loop_process"])
            os.kill(family["loop_process"], signal.SIGSTOP)  # the kernel wakes an orphan
            before = words[Word.HEAD]
            process.kill()
            for pid in family.values():
                wait_for(partial(gone, pid), "the children's end")
            assert "Traceback" not in not_none(process.stderr).read()
        bus.send_signal(signal.SIGTERM)
        bus.wait(timeout=30)
    assert_torque_off(witness(tmp_path))
    rows = LogReader.open(tmp_path / "run.hwlog").rows()["seq"]
    assert list(rows) == list(range(len(rows))) and len(rows) >= before, "none is missing"


def test_a_dead_bus_is_a_lost_servo(tmp_path: Path) -> None:
    with ticking(*run_arguments("--duration", "60"), cwd=tmp_path) as (process, family):
        os.kill(family["program"], signal.SIGKILL)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 4
    report = json.loads(output)
    assert report["stop_reason"] == "trip:servo_lost"
    assert report["torque_off"] is False


@pytest.mark.whole
@pytest.mark.parametrize("who", sampled(["program", "loop_process"], 2))
def test_stalls_of_the_loop_or_its_own_bus_are_waited_for(tmp_path: Path, who: str) -> None:
    """With the limits of a real servo, each of these stalls would end the run."""
    arguments = ["run", "emulated-ideal", "--set=loop.warm_up_s=0.2", "--log", "run.hwlog"]
    arguments += ["--no-plot", "--json"]
    with ticking(*arguments, "--duration", "2", cwd=tmp_path) as (process, family):
        for _ in range(5):
            os.kill(family[who], signal.SIGSTOP)
            time.sleep(0.06)
            os.kill(family[who], signal.SIGCONT)
            time.sleep(0.03)
        output, said = process.communicate(timeout=120)
    report = json.loads(output)
    assert (process.returncode, report["stop_reason"]) == (0, "duration"), said
    assert report["stalled_s"] >= 0.25
    assert report["ticks"] + report["missed_ticks"] == 2000, "on the grid"
    assert any("waited" in text for text in report["warnings"])


def on(port: str, *more: str) -> list[str]:
    words = [f"servo.port={port}", *more]
    return ["xm430-w350", *PATIENT, *BELIEF, *(w for s in words for w in ("--set", s))]


@pytest.mark.whole
def test_another_run_finds_the_port_busy(tmp_path: Path, cli: Cli) -> None:
    for folder in map(tmp_path.joinpath, "abcde"):
        folder.mkdir()
        with emulator(folder) as (bus, port):
            arguments = ["run", *on(port), "--log", "run.hwlog", "--no-plot", "--json"]
            with ticking(*arguments, cwd=folder) as (process, _):
                status, _, message = cli("run", *on(port), "--log", folder / "other.hwlog")
                disturbed = process.poll() is not None
                process.send_signal(signal.SIGINT)
                output, _ = process.communicate(timeout=60)
            bus.send_signal(signal.SIGTERM)
            bus.wait(timeout=30)
        assert status == 4 and port in message
        assert f"pid {process.pid}" in message or "is used by" in message
        if not spoiled(process, output):
            break
    assert (disturbed, process.returncode) == (False, 130)
    assert_torque_off(witness(folder))


@pytest.mark.whole
def test_a_run_on_hardware_that_loses_its_terminal_ends_with_torque_off(tmp_path: Path) -> None:
    with emulator(tmp_path) as (bus, port):
        arguments = ["run", *on(port), "--log", "run.hwlog", "--no-plot", "--json"]
        with ticking(*arguments, cwd=tmp_path) as (process, _):
            process.send_signal(signal.SIGHUP)
            process.communicate(timeout=60)
            assert process.returncode in (130, 3), "3: a stall of this machine came before"
        bus.send_signal(signal.SIGTERM)
        bus.wait(timeout=30)
    assert_torque_off(witness(tmp_path))


WITHOUT_RIGHTS = """
import ctypes, os, resource, sys
libc = ctypes.CDLL(None)
for capability in (23, 14):  # CAP_SYS_NICE, CAP_IPC_LOCK: what root would regain at exec
    libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def without_rights(tmp_path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A run as a user without real-time rights would have it."""
    words = [WITHOUT_RIGHTS, *PROGRAM[1:], "run", "simulated", *arguments]
    return python("-c", *words, cwd=tmp_path, timeout=120)


@pytest.mark.whole
def test_strict_refuses_without_rights_and_names_the_command(tmp_path: Path) -> None:
    done = without_rights(tmp_path, "--set", "realtime.profile=strict", "--duration", "1")
    assert done.returncode == 4
    assert done.stdout == ""
    assert "realtime.profile is strict" in done.stderr
    assert "to grant it: " in done.stderr, "the table of wanted and got comes first"
    assert "rtprio" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.whole
def test_best_effort_runs_without_rights_and_says_what_it_did_not_get(tmp_path: Path) -> None:
    done = without_rights(tmp_path, "--duration", "0.2", "--no-plot", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    settings = {setting["name"]: setting for setting in report["realtime"]}
    assert not settings["scheduler"]["ok"]
    assert not settings["memory"]["ok"]
    assert any("rtprio" in text for text in report["warnings"])


PEDAL = """
import fcntl, os

usual = fcntl.ioctl

def ioctl(descriptor, request, *given):
    if request >> 8 & 0xFF != ord("E"):
        return usual(descriptor, request, *given)
    asks_for_the_state = request & 0xFF == 0x18
    if not asks_for_the_state or os.pread(descriptor, 1, 0) == b"1":
        if isinstance(given[0], bytearray):
            given[0][7] = 2
    return 0

fcntl.ioctl = ioctl
"""
"""Makes a file an input device with one key, which is down where the file says 1"""


@pytest.fixture
def pedal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """Presses and releases the pedal of a run with ``--hold pedal``."""
    folder = tmp_path / "device"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(PEDAL)
    paths = (str(folder), os.environ.get("PYTHONPATH"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))

    def press(down: bool) -> None:
        (tmp_path / "pedal").write_text(str(int(down)))

    press(False)
    return press


def test_the_wall_is_on_only_while_the_dead_man_is_held(
    tmp_path: Path, servo: str, pedal: Callable[[bool], None]
) -> None:
    """Held, let go, held again: the log tells what the torque was."""
    words = ["--hold", "pedal", "--set", "servo.hand=none", "--duration", "60"]
    words += ["--set", "wall.side=both", "--set", "servo.kick=0.05"]
    with ticking(*run_arguments(*words, servo=servo), cwd=tmp_path) as (process, family):
        path = tmp_path / "run.hwlog"
        control = shared_words(family["loop_process"])
        assert control[Word.HELD_NS] == 0, "nobody has pressed it"

        def last_flags() -> int | None:
            with contextlib.suppress(Exception):  # the last block may be half written
                return int(LogReader.open(path).rows()["flags"][-1])
            return None

        off = FLAG_WARM_UP | FLAG_OFF
        assert not_none(last_flags()) & FLAG_WARM_UP
        for _ in range(2):
            pedal(True)
            wait_for(lambda: (f := last_flags()) is not None and not f & off, "the wall on")
            time.sleep(0.6)  # so that the supervisor has looked
            pedal(False)
            wait_for(lambda: (f := last_flags()) is not None and f & FLAG_OFF, "the wall off")
            time.sleep(0.6)
        process.send_signal(signal.SIGHUP)
        out, said = process.communicate()
    assert process.returncode == 130
    told = [line for line in said.splitlines() if line.startswith("--hold: ")]
    assert told[0] == "--hold: released; the wall is off"
    assert "--hold: the wall is on again" in told
    report = json.loads(out)
    assert (report["wall_came_on"], report["torque_off"]) == (True, True)
    rows = LogReader.open(path).rows()
    is_off = (rows["flags"] & off) != 0
    assert not np.any(rows["torque"][is_off])
    assert np.any(rows["torque"][~is_off]), "it pulls the shaft, and friction keeps it beside"


@pytest.mark.whole
@pytest.mark.usefixtures("pedal")
def test_a_run_without_its_dead_man_never_comes_on(tmp_path: Path, servo: str) -> None:
    arguments = run_arguments("--hold", "pedal", "--duration", "0.5", servo=servo)
    with started(*arguments, cwd=tmp_path) as process:
        out, said = process.communicate()
    assert process.returncode == 3
    report = json.loads(out)
    assert report["wall_came_on"] is False
    assert report["waited_for"] == "the dead man is not held; the wall comes on when it is"
    assert report["waited_for"] in said


@pytest.mark.whole
@pytest.mark.parametrize("place", sampled(["in the way", "a long name", "killed"], 3))
def test_a_run_without_its_door_goes_on_and_says_so(tmp_path: Path, place: str) -> None:
    log = f"{'x' * 240}.hwlog" if place == "a long name" else "run.hwlog"
    if place == "in the way":
        (tmp_path / f"{log}.sock").mkdir()
    words = ["run", "emulated-ideal", "--log", log, "--no-plot", "--json", *PATIENT]
    for _ in range(5):
        with started(*words, "--duration", "1", cwd=tmp_path) as process:
            if place == "killed":
                door = wait_for(lambda: children(process.pid).get("door"), "the door")
                os.kill(door, signal.SIGKILL)
            output, said = process.communicate()
        report = json.loads(output)
        if report.get("stop_reason") not in STALLED:
            break
    assert (process.returncode, report["stop_reason"]) == (0, "duration"), said
    assert report["log"] == log
    assert "the run goes on without it" in said or "the running wall cannot be changed" in said
