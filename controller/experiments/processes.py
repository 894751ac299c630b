"""Runs computations in parallel processes of this machine, which end with their parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import TypeVar

from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.system.signals import held_back, interrupting
from haptic_wall.hw.errors import Problem

Key = TypeVar("Key")
Result = TypeVar("Result")


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
        _track_resources()
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
            what = "a computing process was killed from outside, perhaps for lack of memory"
            raise PlatformError(Problem(what, advice="try with fewer workers")) from error
        except BaseException:
            stop.close()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def results(
    pool: Executor, tasks: Iterable[tuple[Key, Callable[[], Result]]]
) -> Iterator[Iterator[tuple[Key, Result]]]:
    """Submit tasks; yield their keys and results as they are done.

    Tasks that have not begun when the block is left are cancelled.

    Args:
        pool: Any executor; it stays open.
        tasks: Each with its key; picklable where the executor wants that.

    Raises:
        KeyboardInterrupt: After the tasks are submitted.
        Exception: An error of a task, when its result is taken, or of the executor.
    """
    keys: dict[Future[Result], Key] = {}
    try:
        with not_from_the_terminal():
            for key, task in tasks:
                keys[pool.submit(task)] = key
        yield ((keys[done], done.result()) for done in as_completed(keys))
    finally:
        for future in keys:
            future.cancel()


def _end_with_parent(stopped: Connection) -> None:
    """Start a thread in a pool process that ends it with its parent, or on request."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel, stopped])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _track_resources() -> None:
    """Start the resource tracker, which is not to complain of what a killed program has left."""
    sys.warnoptions.append("ignore:resource_tracker")
    resource_tracker.ensure_running()
    sys.warnoptions.pop()


@contextmanager
def not_from_the_terminal() -> Iterator[None]:
    """Block the terminal's signals while processes are started, and deliver them afterwards.

    Raises:
        KeyboardInterrupt: At the end: a half-started process would complain.
    """
    # A process started meanwhile would unblock Ctrl-C.
    _track_resources()
    with interrupting(at_once=False), held_back((signal.SIGINT, signal.SIGHUP)):
        yield
