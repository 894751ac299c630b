"""Searches for a servo inside the guard's belief on which a commanded wall is not stable.

scripts/study guard [--beliefs N] [--truths N] [--servos N] [--seed S] [--only PART] [--quick]
"""

from scripts.guard_links import LINKS
from scripts.guard_truths import DRAWN, SEARCHED, STIFFER
from scripts.study import Option, Study

STUDY = Study(
    "evidence/guard.md",
    (DRAWN, STIFFER, SEARCHED, LINKS),
    (
        Option("servos", 10_000, "true servos that are drawn, with every effect", quick=1000),
        Option("population", 4, "walls of a generation, for each coordinate", quick=1),
        Option("generations", 12, "of the search over servos with every effect", quick=2),
        Option("beliefs", 720, "random beliefs of each kind with a link", quick=3),
        Option("truths", 500, "random truths of each", quick=50),
        Option("steps", 6, "generations of the search over them", quick=2),
        Option("seed", 1, "seed of all draws"),
    ),
)
