"""Runs computations on a Dask cluster."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager, suppress

from haptic_wall.controller.errors import PlatformError, UserError
from haptic_wall.hw.errors import Problem

_ADDRESS = re.compile(r"[a-z]+://\S+:\d+")
_PATIENCE_S = 10.0
"""Time for the scheduler to answer [s]"""


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield an executor on a cluster, which stays as it is.

    Tasks of a worker that is lost are done again by others. The last digits of workers with another
    version of this program, of NumPy or of SciPy could differ.

    Args:
        address: Of the scheduler, such as ``tcp://127.0.0.1:8786``.

    Raises:
        UserError: Dask is not installed, there is no scheduler, or no worker.
        PlatformError: The cluster or too many of its workers were lost, or one lacks a package.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise UserError(
            "found no Dask in this environment",
            field="--dask",
            given=address,
            advice="run pip install -e '.[dask]' in the clone",
        ) from None
    client = None
    with suppress(OSError, ValueError):
        if _ADDRESS.fullmatch(address):
            client = Client(address, timeout=_PATIENCE_S, set_as_default=False)
    if client is None:
        raise UserError(
            "found no scheduler of Dask there",
            field="--dask",
            given=address,
            wanted="an address such as tcp://127.0.0.1:8786",
            advice="start one with dask scheduler, and workers with dask worker ADDRESS",
        )
    with client:
        if not client.nthreads():
            raise UserError(
                "found no workers there",
                field="--dask",
                given=address,
                advice=f"start some: dask worker {address} --nworkers -1 --nthreads 1",
            )
        try:
            yield client.get_executor(pure=False)
        except (KilledWorker, CancelledError, ModuleNotFoundError) as error:
            what = f"the cluster at {address} failed: {type(error).__name__}: {error}"
            advice = "look at its logs; each worker needs the packages that are here"
            raise PlatformError(Problem(what, advice=advice)) from error
