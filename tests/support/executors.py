"""Executes tasks in this process."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class AtOnce(Executor):
    """The least there can be: each task is pickled there and back, and done when submitted."""

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self.tasks = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if self.most is not None and self.tasks >= self.most:
            return future  # somebody will do it some day
        self.tasks += 1
        fn, args, kwargs = pickle.loads(pickle.dumps((fn, args, kwargs)))
        future.set_result(pickle.loads(pickle.dumps(fn(*args, **kwargs))))
        return future
