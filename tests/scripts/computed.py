"""Whether the parts of a page are what its study computes now."""

from collections.abc import Collection
from typing import Any

from scripts.study import PART, ROOT, Study, found, usual


def stale(study: Study, names: Collection[str] | None = None, **options: Any) -> list[str]:
    """The parts of a page, all or some by name, that a study would write anew."""
    text = (ROOT / "docs" / study.page).read_text(encoding="utf-8")
    there = {mark[2]: mark[3] for mark in PART.finditer(text)}
    made = {
        part.name: "".join(f"{line}\n" for line in part.lines(found(part, usual(study, **options))))
        for part in study.parts
        if names is None or part.name in names
    }
    return [name for name, lines in made.items() if there[name] != lines]
