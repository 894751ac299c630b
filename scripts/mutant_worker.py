"""Runs tests in forks of a process that has loaded everything but the project; jobs are lines.

A job is a JSON object on standard input: ``tree`` (a copy of the project), ``paths`` (put first in
sys.path), ``tests`` (what pytest is given), ``cpu_s`` and ``idle_s`` (limits), ``all`` (do not stop
at the first failure). The answer is a JSON object on standard output: ``outcome`` (passed, failed,
timeout), ``failed`` (tests), ``tests`` (seconds of processor time and statements
that ran, by test), ``seconds``, ``cpu_s``.

Started by its path, not as a module: nothing of the project may be loaded here.
"""

from __future__ import annotations

import builtins
import contextlib
import importlib
import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from pathlib import Path
from typing import Any

LOADED = (
    *("pytest", "_pytest.assertion.rewrite", "hypothesis", "hypothesis.strategies", "numpy"),
    *("numpy.testing", "scipy.optimize", "scipy.linalg", "scipy.signal", "pydantic", "yaml"),
    *("click", "serial", "dynamixel_sdk", "multiprocessing", "unittest.mock"),
)
"""Takes longer to load than most tests take to run"""


class _Recorder:
    """Notes how long each test takes, which statements it runs, and which fail."""

    def __init__(self) -> None:
        self.tests: dict[str, dict[str, Any]] = {}
        self.failed: list[str] = []
        self._hits: set[str] = set()
        self._began = 0.0

    def pytest_configure(self) -> None:
        builtins.mutant_hits = self._hits.add  # type: ignore[attr-defined]

    def pytest_runtest_logstart(self) -> None:
        self._hits.clear()
        self._began = time.process_time()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        seconds = round(time.process_time() - self._began, 4)
        self.tests[nodeid] = {"seconds": seconds, "hits": sorted(self._hits)}

    def pytest_runtest_logreport(self, report: Any) -> None:  # noqa: ANN401 - pytest's
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_collectreport(self, report: Any) -> None:  # noqa: ANN401 - pytest's
        if report.failed:
            self.failed.append(report.nodeid or "collection")


def _in_child(job: dict[str, Any], answer: int) -> None:
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_CPU, (int(job["cpu_s"]) + 1, int(job["cpu_s"]) + 5))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.dup2(os.open(os.devnull, os.O_RDWR), 0)
    told = os.open(Path(job["tree"]).with_suffix(".txt"), os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(told, stream)
    os.chdir(job["tree"])
    sys.path[:0] = job["paths"]
    os.environ["PYTHONPATH"] = os.pathsep.join(job["paths"])
    import pytest
    from hypothesis import settings

    settings.register_profile("mutants", database=None, derandomize=True, deadline=None)
    settings.load_profile("mutants")
    recorder = _Recorder()
    options = ["-q", "-p", "no:cacheprovider", "-m", "not realtime", "--rootdir", job["tree"]]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # it is loaded already
    if not job["all"]:
        options.append("-x")
    status = pytest.main([*options, *job["tests"]], plugins=[recorder])
    found = {"status": int(status), "failed": recorder.failed, "tests": recorder.tests}
    with os.fdopen(answer, "w") as file:
        json.dump(found, file)


def done(job: dict[str, Any]) -> dict[str, Any]:
    """Do a job in a fork, within its limits."""
    began = time.monotonic()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.close(reading)
            _in_child(job, writing)
            status = 0
        except BaseException:  # noqa: BLE001 - told where the tests' output is, and by the status
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(writing)
    with contextlib.suppress(OSError):
        os.setpgid(child, child)
    text = _read(reading, child, job["idle_s"])
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    took = {
        "seconds": round(time.monotonic() - began, 2),
        "cpu_s": round(used.ru_utime + used.ru_stime, 2),
    }
    if not text:
        late = text is None or (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU)
        outcome = "timeout" if late else "failed"
        return {"outcome": outcome, "failed": [], "tests": {}, **took}
    told: dict[str, Any] = json.loads(text)
    outcome = "passed" if told.pop("status") in (0, 5) else "failed"
    return {"outcome": outcome, **told, **took}


def _read(descriptor: int, child: int, idle_s: float) -> str | None:
    """All that comes until the other end is closed; None: the child has slept for too long.

    Time in which it runs, or waits for a processor, does not count: the limit on processor time
    ends what runs for ever, and a busy machine must not look like a hang.
    """
    began, busy_s = time.monotonic(), 0.0
    parts: list[bytes] = []
    with os.fdopen(descriptor, "rb") as file:
        while True:
            ready, _, _ = select.select([file], [], [], 1.0)
            if ready:
                part = os.read(file.fileno(), 1 << 16)
                if not part:
                    return b"".join(parts).decode()
                parts.append(part)
                continue
            busy_s = max(busy_s, _busy_s(child))
            if time.monotonic() - began - busy_s > idle_s:
                return None


def _busy_s(process: int) -> float:
    """Time that a process and its children have run or waited for a processor [s]."""
    place, total = Path(f"/proc/{process}"), 0.0
    with contextlib.suppress(OSError, ValueError):
        ran, waited, _ = (place / "schedstat").read_text().split()
        total += (int(ran) + int(waited)) * 1e-9
        for other in (place / "task" / str(process) / "children").read_text().split():
            total += _busy_s(int(other))
    return total


def main() -> None:
    """Load what takes long, then do jobs until standard input ends."""
    here = str(Path(__file__).resolve().parent)
    sys.path[:] = [place for place in sys.path if place and str(Path(place).resolve()) != here]
    for name in LOADED:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    for line in sys.stdin:
        print(json.dumps(done(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
