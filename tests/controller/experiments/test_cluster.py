"""A map on a cluster is the same to the last bit, whatever happens to workers."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np
import pytest
from distributed import Client

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.cluster import cluster
from haptic_wall.controller.experiments.maps.maps import MapQuestion, critical_map
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.settings.load import load_config

_WORKERS = 2


@pytest.fixture
def address() -> Iterator[str]:
    """The address of a scheduler with two worker processes."""
    with ExitStack() as during:

        def started(*words: str) -> subprocess.Popen[str]:
            command = [sys.executable, "-m", *words, "--no-dashboard"]
            process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            during.enter_context(process)
            during.callback(process.kill)
            return process

        scheduler = started("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        assert scheduler.stderr is not None
        found = (re.search(r"tcp://\S+", line) for line in scheduler.stderr)
        address = next(filter(None, found))[0]
        for _ in range(_WORKERS):
            started("distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1")
        yield address


@pytest.mark.whole
def test_a_map_is_the_same_although_a_worker_is_killed(address: str) -> None:
    setting = MapSettings.of(load_config("simulated", ()).config)
    asked = MapQuestion(setting, [0.0, 0.1], [0, 1, 2], [0.1], tolerance=0.1)
    with Client(address) as client:
        client.wait_for_workers(_WORKERS)
    with cluster(address) as pool:
        victim = pool.submit(os.getpid).result()
        killing = iter([partial(os.kill, victim, signal.SIGKILL)])

        def progress(_done: int, _all: int) -> None:
            next(killing, int)()

        found = critical_map(asked, executor=pool, progress=progress)
    for task in asked.tasks():
        np.testing.assert_array_equal(found.stiffness[task], asked.compute(task)())
    assert next(killing, None) is None


@pytest.mark.parametrize("address", ["127.0.0.1:8786", "tcp://127.0.0.1:1x", "tcp://nowhere"])
def test_an_address_without_a_scheduler_is_refused(address: str) -> None:
    with (
        pytest.raises(UserError, match=r"--dask .*: found no scheduler of Dask there"),
        cluster(address),
    ):
        pass
