"""A pool of worker processes that end with their parent, and at once when it gives up."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait

from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.system.signals import held_back, interrupting
from haptic_wall.hw.errors import Problem


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Yield an executor with ``count`` processes.

    When the block is left with an exception (Ctrl-C is one), they are ended immediately: a task may
    take minutes, and its result is no longer needed.

    Args:
        count: >= 1.

    Raises:
        PlatformError: One of them was ended from outside.
    """
    # The resource tracker cleans up after this process, and must outlive it.
    with held_back((signal.SIGHUP,)):
        resource_tracker.ensure_running()
    # Spawned, not forked: the caller may have threads.
    context = multiprocessing.get_context("spawn")
    stopped, stop = context.Pipe(duplex=False)
    with stopped, stop:
        pool = ProcessPoolExecutor(
            count, mp_context=context, initializer=_end_with_parent, initargs=(stopped,)
        )
        try:
            yield pool
        except BrokenExecutor as error:
            what = "a process that computes was ended from outside, perhaps because memory ran out"
            raise PlatformError(Problem(what, advice="try with fewer workers")) from error
        except BaseException:
            stop.close()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _end_with_parent(stopped: Connection) -> None:
    """Start a thread in a pool process that ends it with its parent, or on request."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel, stopped])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def not_from_the_terminal() -> Iterator[None]:
    """Block the terminal's signals while processes are started, and deliver them afterwards.

    Raises:
        KeyboardInterrupt: At the end: a half-started process would complain.
    """
    # A process started meanwhile would unblock Ctrl-C.
    resource_tracker.ensure_running()
    with interrupting(at_once=False), held_back((signal.SIGINT, signal.SIGHUP)):
        yield
