"""Loads that chaos starts beside a run, each in a process of its own that dies with its parent.

busy CORE; hog CORE SECONDS; memory MB SECONDS; clock STEP SECONDS; flood PORT SECONDS; watch CORE;
strangers; clients LOG SECONDS
"""

import contextlib
import ctypes
import ctypes.util
import mmap
import os
import resource
import signal
import socket
import sys
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.processes import run_socket
from haptic_wall.controller.runtime import realtime

HOG_PRIORITY, WATCH_PRIORITY = 85, 99
"""Above the loop's; above everything"""
WATCH_S = 0.005
"""How often the machine is asked for a sign of life [s]"""
STRANGERS_S = 1.0
"""How often others' real-time programs are looked for [s]"""
RAN_MS = 10
"""Least processor time of another real-time program between two looks [ms]"""
_PARENT, _USER, _SYSTEM, _START, _VIRTUAL_SIZE, _POLICY = 1, 11, 12, 19, 20, 38
"""Places in /proc/PID/stat, counted from the state on"""
_REAL_TIME = (str(os.SCHED_FIFO), str(os.SCHED_RR))
CLIENTS, CLIENT_BYTES = 1000, 100_000_000
"""Connections at a time, and the longest that one of them sends"""
NOBODY = 65534
LEAST_S = 0.005
"""Shorter stalls are not written down [s]"""


def busy(core: int) -> None:
    """An ordinary process that never rests, until it is ended."""
    os.sched_setaffinity(0, {core})
    while True:
        pass


def hog(core: int, seconds: float) -> None:
    """Hold a core at real-time priority, ahead of all below it; say since when [s]."""
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HOG_PRIORITY))
    held_s = time.monotonic()
    print(f"{held_s:.6f}", flush=True)
    while time.monotonic() < held_s + seconds:
        pass


def clients(log: Path, seconds: float) -> Counter[str]:
    """Open a thousand connections to a running wall, which ask for nothing that can be granted.

    Some send half a line, some 100 MB without one, some garbage, some a change that is refused, and
    some nothing.

    Returns:
        How many connections were taken, and how many of them closed from the other side.
    """
    end = time.monotonic() + seconds
    contents = (
        b'{"set": ["wall.st',
        bytes(CLIENT_BYTES),
        b"\xff\x00\n" * 1000,
        b'{"set": ["loop.rate_hz=1"]}\n',
        b"",
    )
    found: Counter[str] = Counter()
    place = str(run_socket.socket_of(log))
    open_ones: list[tuple[socket.socket, memoryview]] = []
    number = 0
    while time.monotonic() < end:
        if len(open_ones) < CLIENTS:
            one = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
            try:
                one.connect(place)
            except OSError:  # too many wait already, or the wall's process is dead
                one.close()
            else:
                open_ones.append((one, memoryview(contents[number % len(contents)])))
                found["taken"] += 1
                number += 1
        for at, (one, rest) in enumerate(open_ones):
            try:
                open_ones[at] = one, rest[one.send(rest[:65536]) :] if len(rest) else rest
                if not one.recv(65536):
                    raise ConnectionResetError
            except BlockingIOError:
                continue
            except OSError:
                one.close()
                found["closed"] += 1
        open_ones = [each for each in open_ones if each[0].fileno() >= 0]
    for one, _ in open_ones:
        one.close()
    return found


def try_as_nobody(log: Path) -> None:
    """Fail where another user can connect to a running wall; needs root's rights.

    Raises:
        RuntimeError: The other user was let in.
    """
    os.seteuid(NOBODY)
    try:
        run_socket.connected(run_socket.socket_of(log)).close()
    except OSError:
        return
    finally:
        os.seteuid(0)
    raise RuntimeError(f"another user could connect to {run_socket.socket_of(log)}")


def memory(megabytes: int, seconds: float) -> None:
    """Touch every page of so much memory, keep it for a while, give it back."""
    Path("/proc/self/oom_score_adj").write_text("1000")  # the first process to be killed
    end = time.monotonic() + seconds
    with mmap.mmap(-1, megabytes << 20) as pages:
        for at in range(0, len(pages), mmap.PAGESIZE):
            pages[at] = 1
        while time.monotonic() < end:
            time.sleep(0.05)


def clock(step_s: float, seconds: float) -> None:
    """Set the system's clock wrong for a while, then right again, whatever happens meanwhile.

    Right is what the monotonic clock says of the time that has passed.
    """
    stopped = False

    def stop(_number: int, _frame: object) -> None:
        nonlocal stopped
        stopped = True

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    realtime.die_with_parent(os.getppid(), signal.SIGTERM)
    offset = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()
    end = time.monotonic() + seconds
    try:
        time.clock_settime(time.CLOCK_REALTIME, time.monotonic() + offset + step_s)
        while time.monotonic() < end and not stopped:
            time.sleep(0.02)
    finally:
        time.clock_settime(time.CLOCK_REALTIME, time.monotonic() + offset)


def watch(core: int) -> None:
    """Ask for a sign of life every few milliseconds; say when none came: from and until [s]."""
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(WATCH_PRIORITY))
    libc = ctypes.CDLL(ctypes.util.find_library("c"))
    libc.mlockall(3)
    last = time.monotonic()
    while True:
        time.sleep(WATCH_S)
        now = time.monotonic()
        if now - last >= WATCH_S + LEAST_S:
            print(f"{last:.6f} {now:.6f}", flush=True)
        last = now


def strangers(ours: int) -> None:
    """Look out for real-time programs of others that run; say when: from and until [s]."""
    os.nice(10)
    last, before = time.monotonic(), others(ours)
    while True:
        time.sleep(STRANGERS_S)
        now, seen = time.monotonic(), others(ours)
        if ran_at_real_time(before, seen):
            print(f"{last:.6f} {now:.6f}", flush=True)
        last, before = now, seen


@dataclass(frozen=True, slots=True)
class Other:
    """A program that no process of ours has started."""

    real_time: bool
    """It may run ahead of ordinary ones, which most of these hardly ever do"""
    ran_ms: int
    """Processor time since it began [ms]"""


def others(ours: int, proc: Path = Path("/proc")) -> dict[tuple[int, str], Other]:
    """The programs of others, each by its pid and its start: pids are given again."""
    parents, found = {}, {}
    for folder in proc.iterdir():
        with contextlib.suppress(OSError, ValueError):
            pid = int(folder.name)
            words = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[pid] = int(words[_PARENT])
            ticks = int(words[_USER]) + int(words[_SYSTEM])
            # Kernel threads have no memory of their own.
            real_time = words[_POLICY] in _REAL_TIME and words[_VIRTUAL_SIZE] != "0"
            ran_ms = 1000 * ticks // os.sysconf("SC_CLK_TCK")
            found[pid, words[_START]] = Other(real_time, ran_ms)
    return {key: other for key, other in found.items() if not _descends(key[0], ours, parents)}


def ran_at_real_time(
    before: Mapping[tuple[int, str], Other], now: Mapping[tuple[int, str], Other]
) -> bool:
    """Whether a real-time program of others has had the processor between two looks."""
    unborn = Other(real_time=False, ran_ms=0)
    return any(
        other.real_time and other.ran_ms - before.get(key, unborn).ran_ms >= RAN_MS
        for key, other in now.items()
    )


def _descends(pid: int, ancestor: int, parents: dict[int, int]) -> bool:
    while pid > 1:
        if pid == ancestor:
            return True
        pid = parents.get(pid, 0)
    return False


def flood(port: int, seconds: float) -> None:
    """Connect to a live page again and again, send nonsense and large messages, read nothing."""
    asks = b"GET /rows HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    asks += b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    large = b"\x82\xff" + (100_000_000).to_bytes(8, "big") + bytes(100_000)
    kinds = (
        b"",
        bytes(range(256)) * 40,
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000,
        asks,
        asks + large,
    )
    kept: deque[socket.socket] = deque(maxlen=200)
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        count += 1
        if len(kept) == kept.maxlen:
            kept[0].close()
        with contextlib.suppress(OSError):
            kept.append(socket.create_connection(("127.0.0.1", port), timeout=0.2))
            kept[-1].send(kinds[count % len(kinds)])
        time.sleep(0.002)


def own_mounts() -> bool:
    """Give this process mounts of its own, which end with it; whether that was granted."""
    libc = ctypes.CDLL(None, use_errno=True)
    clone_newns, ms_rec, ms_private = 0x20000, 0x4000, 0x40000
    if libc.unshare(clone_newns):
        return False
    return not libc.mount(b"none", b"/", None, ctypes.c_ulong(ms_rec | ms_private), None)


def may_set_clock() -> bool:
    """Whether this process has the right to set the system's clock."""
    cap_sys_time = 25
    status = Path("/proc/self/status").read_text()
    (effective,) = (line for line in status.splitlines() if line.startswith("CapEff"))
    return bool(int(effective.split()[1], 16) >> cap_sys_time & 1)


def main() -> None:
    """Do what the arguments say."""
    kind, *numbers = sys.argv[1:]
    if kind != "clock":
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
        realtime.die_with_parent(os.getppid(), signal.SIGKILL)
    match kind:
        case "busy":
            busy(int(numbers[0]))
        case "hog":
            hog(int(numbers[0]), float(numbers[1]))
        case "memory":
            memory(int(numbers[0]), float(numbers[1]))
        case "clock":
            clock(float(numbers[0]), float(numbers[1]))
        case "flood":
            flood(int(numbers[0]), float(numbers[1]))
        case "clients":
            _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
            if os.geteuid() == 0:
                try_as_nobody(Path(numbers[0]))
            clients(Path(numbers[0]), float(numbers[1]))
        case "watch":
            watch(int(numbers[0]))
        case "strangers":
            strangers(os.getppid())


if __name__ == "__main__":
    main()
