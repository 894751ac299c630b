"""Makes a part of a page from trials that are drawn job by job."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from scripts.study import Given, Option, Part

Result = TypeVar("Result")
Job = tuple[Any, ...]
"""The arguments of a job; the last one is the seed of all it draws"""
WALLS_TRIED = Option("walls", 25, "walls in each row with a believed lag", quick=0)
HOURS_TRIED = Option("hours", 3.0, "hours of each operator model on each servo", quick=1.0 / 720.0)
GENERATIONS = Option("generations", 8, "generations of each worst-case search", quick=1)


@dataclass(frozen=True, slots=True)
class Made:
    """A section's text, and its faulty cases."""

    lines: list[str]
    wrong: list[tuple[str, object]]
    """Description of each fault, and its case, whose text can be run again"""


def section(
    name: str,
    jobs: Callable[[Given], Iterable[Job]],
    work: Callable[[Job], Result],
    told: Callable[[list[Result]], Made],
    case_s: float,
) -> Part[Job, Result]:
    """Return the part of a page.

    Args:
        name: Name of the part.
        jobs: Jobs from the options; what is drawn depends on their seed, the section, and the job.
        work: Does a job.
        told: Makes the text from the results of the jobs, in their order.
        case_s: Time for one job on one core, about [s].
    """
    return Part(
        name,
        jobs,
        work,
        lambda found: told([row for _, row in found]).lines,
        case_s,
        examples=lambda found: told([row for _, row in found]).wrong,
    )


def walls_of(given: Given, times: int) -> int:
    """Return a multiple of the walls of a row, at least one."""
    return max(1, times * int(given.walls))


def in_parts(count: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield number and size of each part of some trials; ``most``: of a part."""
    for part in range(-(-count // most)):
        yield part, min(most, count - part * most)


def draws(seed: Sequence[int]) -> np.random.Generator:
    """Return a job's random generator; its seed is the page's, the section, and the job."""
    return np.random.default_rng(list(seed))
