"""Makes the sections of a measured page, in parallel, and puts them in place.

Each section is made by itself, so that one can be measured anew while the others stay as they are.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from typing import Any

import numpy as np

NICE = 10
_MARK = "<!-- section: {} -->"


@dataclass(frozen=True, slots=True)
class Amount:
    """Numbers of trials."""

    seed: int = 3
    walls: int = 25
    """In each row with a believed lag; twice and three times as many beyond"""
    hours: float = 3.0
    """Of each operator, for each servo [h]"""
    trial_s: float = 60.0
    """Length of a trial with an operator [s]"""
    generations: int = 8
    """Of each worst-case search"""

    def walls_of(self, times: int) -> int:
        """Return a multiple of the walls of a row, at least one."""
        return max(1, times * self.walls)


QUICK = Amount(walls=0, hours=1.0 / 720.0, trial_s=5.0, generations=1)
"""Enough to check that everything runs"""


@dataclass(frozen=True, slots=True)
class Job:
    """A part of a section, for one process."""

    work: Callable[..., Any]
    """Importable by other processes; its last argument is the seed of all it draws"""
    arguments: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Made:
    """A section's text, and its faulty cases."""

    lines: list[str]
    wrong: list[tuple[str, object]]
    """Description of each fault, and its case, whose text can be run again"""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page."""

    name: str
    title: str
    jobs: Callable[[Amount], list[Job]]
    told: Callable[[list[Any]], Made]
    """Makes its text from the results of the jobs, in their order"""


def draws(seed: Sequence[int]) -> np.random.Generator:
    """Return a job's random generator; its seed is the page's, the section, and the job."""
    return np.random.default_rng(list(seed))


def measured(
    pool: Executor, sections: Iterable[Section], amount: Amount, command: str
) -> dict[str, Made]:
    """Make the sections' texts; reproducible for the same amount, except for the elapsed time.

    Args:
        pool: Computes.
        sections: The sections.
        amount: Numbers of trials.
        command: The command that makes them, for the page.
    """
    made = {}
    for section in sections:
        begin = time.monotonic()
        submitted = [pool.submit(_nicely, job.work, job.arguments) for job in section.jobs(amount)]
        for done, _ in enumerate(as_completed(submitted), 1):
            if done % 20 == 0 or done == len(submitted):
                sys.stderr.write(f"{section.name}: {done} of {len(submitted)} parts done\n")
        told = section.told([one.result() for one in submitted])
        took = time.monotonic() - begin
        length = f"{took:.0f} s" if took < 100 else f"{took / 60:.0f} min"
        head = [f"## {section.title}", "", f"By `{command}`, {length}.", ""]
        made[section.name] = Made([*head, *told.lines], told.wrong)
    return made


def renewed(page: str, head: str | None, order: Sequence[str], made: dict[str, Made]) -> str:
    """Return a page with new sections; the others, and the head, stay unless they are made anew.

    Args:
        page: The present page; may be empty.
        head: Text above all sections; None: stays.
        order: Names of all sections.
        made: The new ones.
    """
    pieces = re.split(r"^<!-- section: ([\w-]+) -->\n", page, flags=re.MULTILINE)
    kept = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    text = pieces[0] if head is None else head
    text = text.rstrip("\n") + "\n"
    for name in order:
        body = "\n".join(made[name].lines) if name in made else kept.get(name)
        if body is not None:
            text += "\n" + _MARK.format(name) + "\n" + body.strip("\n") + "\n"
    return text


def _nicely(work: Callable[..., Any], arguments: tuple[Any, ...]) -> object:
    """Work at low priority from now on."""
    os.setpriority(os.PRIO_PROCESS, 0, max(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    return work(*arguments)
