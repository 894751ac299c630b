"""The pages as the tests read them: commands in ``sh`` blocks, tables."""

import re
import shlex
from pathlib import Path

from scripts.website import pages_of

ROOT = Path(__file__).parents[2]
PAGES = tuple(pages_of(ROOT))


def text_of(name: str) -> str:
    return (ROOT / name).read_text()


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def commands() -> list[tuple[str, tuple[str, ...]]]:
    """Every distinct line of the ``sh`` blocks: the page it is first seen on, and its words."""
    found: dict[tuple[str, ...], str] = {}
    for page in PAGES:
        for block in re.findall(r"^ *```sh\n(.*?)^ *```", page.read_text(), re.S | re.M):
            for line in block.splitlines():
                words = tuple(shlex.split(line, comments=True))
                if words:
                    found.setdefault(words, name_of(page))
    return [(page, words) for words, page in found.items()]
