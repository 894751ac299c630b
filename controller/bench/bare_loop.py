"""Runs a bare, hand-written loop on a Dynamixel bus, without this project: the reference.

It reads the 16 bytes from Realtime Tick to Present Position of one servo, or of six by a fast sync
read, writes a goal current of zero to each, and counts the periods that it skipped. As such loops
do, it takes each reply for the answer to its last request. No wall, no guard, no checks, no log: it
shows the least cost of such a loop on the present machine and bus. Torque stays off, so goal
currents have no effect.

    python -m haptic_wall.controller.bench.bare_loop PORT [SECONDS]     one JSON object on
    standard output
"""

import argparse
import contextlib
import gc
import json
import os
import select
import sys
import time

import serial

READ_16_AT_120 = bytes.fromhex("FF FF FD 00 01 07 00 02 78 00 10 00 35 5D")
RETURN_DELAY_0 = bytes.fromhex("FF FF FD 00 01 06 00 03 09 00 00 69 63")
GOAL_CURRENT_0 = bytes.fromhex("FF FF FD 00 FE 0A 00 83 66 00 02 00 01 00 00 15 1D")
BAUD, REPLY_BYTES = 4_000_000, 27
READ_SIX = bytes.fromhex("FF FF FD 00 FE 0D 00 8A 78 00 10 00 01 02 03 04 05 06 3F 7D")
GOALS_SIX = bytes.fromhex(
    "FF FF FD 00 FE 19 00 83 66 00 02 00 "
    "01 00 00 02 00 00 03 00 00 04 00 00 05 00 00 06 00 00 86 01"
)
FRAMES = {1: (READ_16_AT_120, REPLY_BYTES, GOAL_CURRENT_0), 6: (READ_SIX, 128, GOALS_SIX)}
"""By the number of servos, with the ids from 1 on: request, length of the reply, goals"""
PERCENTILES = (50, 99)
"""Of the work of a cycle"""
SPIN_SHARE, PATIENCE_SHARE = 0.15, 0.8
"""Fractions of a period: spinning before the deadline, and waiting for a reply"""


def main() -> None:
    """Run the loop and print the result."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("port")
    parser.add_argument("seconds", type=float, nargs="?", default=10.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="ticks per second")
    parser.add_argument("--servos", type=int, default=1, choices=FRAMES, help="ids from 1 on")
    wanted = parser.parse_args()
    port = serial.Serial(wanted.port, BAUD, timeout=0, exclusive=True)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    gc.disable()
    port.write(RETURN_DELAY_0)
    time.sleep(0.1)
    port.reset_input_buffer()
    figures = loop(port.fileno(), wanted.seconds, round(1e9 / wanted.rate), wanted.servos)
    sys.stdout.write(json.dumps(figures) + "\n")


def loop(descriptor: int, seconds: float, period_ns: int, servos: int) -> dict[str, float]:
    """Read and write once a period [ns] for so long [s]; return counts and times of work."""
    request, reply_bytes, goals = FRAMES[servos]
    spin_ns, patience_ns = round(SPIN_SHARE * period_ns), round(PATIENCE_SHARE * period_ns)
    now = time.monotonic_ns
    missed = 0
    work_ns = []
    deadline = now() + period_ns
    end = deadline + int(seconds * 1e9)
    while deadline < end:
        sleep = deadline - spin_ns - now()
        if sleep > 0:
            time.sleep(sleep * 1e-9)
        while (woke := now()) < deadline:
            pass
        if select.select([descriptor], [], [], 0)[0]:
            os.read(descriptor, 4096)  # a late reply
        os.write(descriptor, request)
        reply = b""
        waited = -now()
        while len(reply) < reply_bytes and (left := woke + patience_ns - now()) > 0:
            # Sleeping, not spinning: bytes arrive through a kernel thread, which a spinning
            # real-time process on the same core would block.
            if select.select([descriptor], [], [], left * 1e-9)[0]:
                reply += os.read(descriptor, 4096)
        waited += now()
        os.write(descriptor, goals)
        ended = now()
        work_ns.append(ended - woke - waited)
        skipped = max(0, (ended - deadline) // period_ns - 1)
        missed += skipped
        deadline += (skipped + 1) * period_ns
    work_ns.sort()
    shares = {f"work_us_p{p}": 1e-3 * work_ns[len(work_ns) * p // 100] for p in PERCENTILES}
    return {"ticks": len(work_ns), "missed_ticks": missed, **shares}


if __name__ == "__main__":
    main()
