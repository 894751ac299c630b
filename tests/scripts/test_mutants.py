"""Small defects are put where they should be, have names that last, and are noticed or not."""

import ast
from pathlib import Path
from typing import Any

import pytest

from scripts import mutants
from scripts.mutant_kinds import (
    ROLES,
    Mutant,
    all_mutants,
    mutants_of,
    mutated,
)
from scripts.mutants import (
    ROOT,
    Workers,
    chosen,
    reached,
    tried,
)

SOURCE = '''"""A module."""

from __future__ import annotations

LIMIT: int = 3


class Counter:
    """Counts."""

    __slots__ = ("count",)

    def __init__(self) -> None:
        self.count = 0

    def add(self, more: float) -> bool:
        """Add."""
        if not more > 0.5 and more != -1:
            raise ValueError("at least 0")
        self.count += min(more, LIMIT)
        return self.count >= LIMIT
'''
KINDS = [
    ("Counter.add:not:1", "if more > 0.5 and more != -1:"),
    ("Counter.add:boundary:1", "if not more >= 0.5 and more != -1:"),
    ("Counter.add:comparison:2", "if not more <= 0.5 and more != -1:"),
    ("Counter.add:comparison:1", "if not more > 0.5 and more == -1:"),
    ("Counter.add:and-or:1", "if not more > 0.5 or more != -1:"),
    ("Counter.add:number:1", "if not more > 1.0 and more != -1:"),
    ("Counter.add:minus:1", "if not more > 0.5 and more != +1:"),
    ("Counter.add:extreme:1", "self.count += max(more, LIMIT)"),
    ("Counter.add:sign:1", "self.count -= min(more, LIMIT)"),
    ("Counter.add:drop:1", "pass"),
    ("Counter.__init__:drop:1", "pass"),
    ("<module>:one-less:1", "LIMIT: int = 2"),
]


def by_name(source: str = SOURCE, path: str = "a.py") -> dict[str, Mutant]:
    return {one.id.removeprefix("guard:"): one for one in mutants_of("guard", path, source)}


@pytest.mark.parametrize(("name", "line"), KINDS)
def test_a_mutant_changes_one_line(name: str, line: str) -> None:
    text, becomes = mutated(SOURCE, by_name()[name].number)
    assert becomes == line
    before = ast.unparse(ast.parse(SOURCE)).splitlines()
    assert sum(old != new for old, new in zip(before, text.splitlines(), strict=True)) == 1


@pytest.fixture(scope="module")
def found() -> list[Mutant]:
    """All mutants of the program."""
    return all_mutants(ROOT)


def test_names_are_unique_and_last_where_a_module_moves(found: list[Mutant]) -> None:
    assert len({one.id for one in found}) == len(found) > 5000
    moved = by_name(f"{SOURCE}\n\ndef more():\n    return 1 + 2\n", "somewhere/else.py")
    assert set(by_name()) < set(moved)
    assert {one.role for one in found} == set(ROLES)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small project with one module, of which one test checks something and one nothing."""
    root = tmp_path / "project"
    package, room = root / "src" / "haptic_wall", root / "controller" / "runtime"
    plugin = root / "controller" / "pytest_plugin"  # of the program, which pytest loads
    for folder in (package, room, plugin, root / "tests"):
        folder.mkdir(parents=True)
    for folder in (package, root / "controller", room, plugin):
        (folder / "__init__.py").write_text("")
    (package / "controller").symlink_to("../../controller")
    (room / "safety.py").write_text(
        "def far(position):\n"
        "    while position > 9:\n"
        "        position -= 1\n"
        "    return position > 2.0 or position == 7\n"
    )
    (root / "tests" / "test_far.py").write_text(
        "from haptic_wall.controller.runtime.safety import far\n\n"
        "def test_far():\n    assert far(3.0) and not far(1.0) and far(10)\n\n"
        "def test_fails():\n    assert not far(3.0)\n"
    )
    (root / "pyproject.toml").write_text('[tool.hatch.build]\ndev-mode-dirs = ["src"]\n')
    monkeypatch.setattr(mutants, "LEAST_S", 2.0)
    return root


@pytest.mark.whole
def test_mutants_are_tried_in_a_copy(project: Path, tmp_path: Path, thorough: bool) -> None:
    source = (project / "controller" / "runtime" / "safety.py").read_text()
    wanted = {
        "safety:far:boundary:2": "survived",
        "safety:far:comparison:2": "killed",
    }
    if thorough:  # takes as long as a mutant may
        wanted["safety:far:sign:1"] = "timeout"
    said: list[str] = []
    outcomes: dict[str, Any] = {}
    workers = Workers(1, project, tmp_path)
    try:
        known = tmp_path / "known.json"
        found = reached(workers, project, ["safety"], known, said.append)
        assert reached(workers, project, ["safety"], known, pytest.fail) == found, "not run again"

        def job(tree: Path, run: Any) -> None:
            for one in all_mutants(project):
                if one.id in wanted:
                    tests = chosen(one, found, 9.0)
                    assert list(tests) == ["tests/test_far.py::test_far"]
                    outcomes[one.id] = tried(one, project, tree, tests, run)["outcome"]

        workers.do([job])
    finally:
        workers.close()
    assert outcomes == wanted
    assert any("fails without a mutant: tests/test_far.py::test_fails" in text for text in said)
    assert (project / "controller" / "runtime" / "safety.py").read_text() == source
