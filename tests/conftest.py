"""Options of the whole test suite."""

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

# Before NumPy is imported: pole searches over small matrices are slower on many threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest
from _pytest.runner import runtestprotocol

from tests.cases import is_left_to_whole

if TYPE_CHECKING:
    from tests.support.program import Cli

# What is said is as wide on every terminal.
os.environ["COLUMNS"] = "98"

STILL_S = 0.1
"""From then on a machine that stands still may fail a test [s]"""
# Says when it was woken too late. Ends what the tests have started, when they have ended:
# a test that is killed cannot. A run that a user starts outlives its terminal where nohup asks for
# it, so the program itself cannot know.
AFTERWARDS = """
import os, select, signal, sys, time
mark = sys.argv[1].encode()
try:
    tests, before = os.pidfd_open(int(sys.argv[2])), time.monotonic()
    while not select.select([tests], [], [], 0.02)[0]:
        now = time.monotonic()
        if now - before > float(sys.argv[3]):
            print("late", flush=True)
        before = now
except (ProcessLookupError, BrokenPipeError):
    pass
for pid in filter(str.isdigit, os.listdir("/proc")):
    try:
        with open(f"/proc/{pid}/environ", "rb") as file:
            if mark in file.read().split(b"\\0") and int(pid) != os.getpid():
                os.kill(int(pid), signal.SIGKILL)
    except OSError:
        pass  # of another user, or gone
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--thorough", action="store_true", help="as many random cases as the documentation claims"
    )
    parser.addoption(
        "--whole", action="store_true", help="also play whole experiments to their end"
    )
    parser.addoption(
        "--browser", action="store_true", help="also look at the live page in a headless Chromium"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Prepare what all tests share."""
    # A property has no stopwatch, and tries the same examples each time unless many are wanted.
    thorough = config.getoption("thorough")
    hypothesis.settings.register_profile(
        "suite",
        deadline=None,
        derandomize=not thorough,
        max_examples=100 if thorough else 40 if config.getoption("whole") else 10,
    )
    hypothesis.settings.load_profile("suite")
    if not (thorough or config.getoption("whole")):
        # Numba's compiler takes 25 s in a fresh clone; --whole compares its code with the source.
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    # An editable install has every module of a plugin's package rewritten, as if it held tests.
    getattr(config.pluginmanager.rewrite_hook, "_must_rewrite", set()).discard("haptic_wall")
    # Thousands of tests are made and kept: looking for garbage among them takes a fifth of it.
    gc.disable()
    begin_to_watch()
    # Begun by nohup, or behind a script, the program and those that tests start would leave the
    # terminal's end and Ctrl-C unheeded.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


stalls: list[int] = []
"""Where the process that watches writes: a file descriptor"""


def begin_to_watch() -> None:
    """Start the process that ends what is left when this one has ended, however it ends."""
    me = str(os.getpid())
    os.environ["TESTS_OF"] = mark = f"{me} {time.monotonic_ns()}"
    told, tells = os.pipe()
    os.set_blocking(told, False)
    subprocess.Popen(
        [sys.executable, "-ISc", AFTERWARDS, f"TESTS_OF={mark}", me, str(STILL_S)],
        stdin=subprocess.DEVNULL,
        stdout=tells,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ).returncode = 0  # nobody waits for it
    os.close(tells)
    stalls.append(told)


def stood_still() -> bool:
    """Whether the machine has stood still since the last call."""
    try:
        return bool(os.read(stalls[-1], 1 << 20))
    except BlockingIOError:
        return False


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test, and again if it failed while the machine stood still, up to twice."""
    where = {"nodeid": item.nodeid, "location": item.location}
    item.ihook.pytest_runtest_logstart(**where)
    stood_still()
    for _ in range(3):
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        if not any(report.failed for report in reports) or not stood_still():
            break
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(**where)
    return True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked ``whole`` or ``thorough``, unless it is asked for."""
    if config.getoption("thorough"):
        return
    whole = config.getoption("whole")
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        left = item.get_closest_marker("thorough") if whole else is_left_to_whole(item)
        (left_out if left else kept).append(item)
    # What waits for processes begins, in one worker, beside those that compute.
    items[:] = sorted(kept, key=lambda item: item.get_closest_marker("realtime") is None)
    config.hook.pytest_deselected(items=left_out)


def pytest_collection_finish() -> None:
    """What is there now stays, and is not looked through again."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: one works at tests that wait more than they compute."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> "Cli":
    """``haptic-wall``, called in this process."""
    from tests.support.program import Cli

    return Cli(capsys)


@pytest.fixture(scope="session")
def wholly(pytestconfig: pytest.Config, thorough: bool) -> bool:
    """Whether whole experiments are played to their end, and each random case is tried."""
    return thorough or bool(pytestconfig.getoption("whole"))


@pytest.fixture(scope="session")
def whole_experiment() -> None:
    """Marks a fixture that plays a whole experiment: its tests run with ``--whole`` only."""


@pytest.fixture(scope="module")
def undrawn(wholly: bool) -> Iterator[None]:
    """Draws a dot as every picture, unless --whole is given: drawing takes half a second."""
    from matplotlib.figure import Figure
    from matplotlib.image import imsave

    def dotted(_figure: Figure, path: Any, **how: Any) -> None:
        imsave(path, [[0.0]], **how)

    with pytest.MonkeyPatch.context() as patch:
        if not wholly:
            patch.setattr(Figure, "savefig", dotted)
        yield


@pytest.fixture(scope="session")
def thorough(pytestconfig: pytest.Config) -> bool:
    """Whether the full number of random cases is wanted, however long it takes."""
    return bool(pytestconfig.getoption("thorough"))
