"""Options of the whole test suite."""

import gc
import os
import signal

# Before NumPy is imported: pole searches over small matrices are slower on many threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

# What is said is as wide on every terminal.
os.environ["COLUMNS"] = "98"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--thorough", action="store_true", help="as many random cases as the documentation claims"
    )


def pytest_configure() -> None:
    """Thousands of tests are made and kept: looking for garbage among them takes a fifth of it."""
    gc.disable()
    # Begun by nohup, or behind a script, the program and those that tests start would leave the
    # terminal's end and Ctrl-C unheeded.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """What is there now stays, and is not looked through again."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: some tests wait for processes more than they compute."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.fixture(scope="session")
def thorough(pytestconfig: pytest.Config) -> bool:
    """Whether the full number of random cases is wanted, however long it takes."""
    return bool(pytestconfig.getoption("thorough"))
