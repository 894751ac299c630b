"""What the pages show is what the program says, and what they list is complete."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import haptic_wall
from haptic_wall.controller.cli.main import COMMANDS
from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.runtime.telemetry import ROW
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from tests.docs.pages import PAGES, ROOT, broken, name_of, text_of
from tests.docs.test_commands import folder  # noqa: F401 - a fixture
from tests.support.program import Cli
from tests.support.report_keys import REPORT_KEYS
from tests.typed import not_none

_IMPORTED = re.compile(r"^(?:>>> )?from (haptic_wall[\w.]*) import (\([\w\s,]+\)|[\w, ]+)$", re.M)

CHANGES = ROOT / "docs" / "changelog.md"
MOST_WORDS = 1500
"""On a page"""


def test_links_lead_somewhere() -> None:
    assert {name_of(page): broken(page) for page in PAGES if broken(page)} == {}


@pytest.mark.whole
def test_the_website_builds(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html"]
    subprocess.run([*words, str(ROOT / "docs"), str(tmp_path)], check=True)
    assert "xm430-w350" in (tmp_path / "how-to" / "hardware.html").read_text()


def test_the_pages_stay_short() -> None:
    """Each but the generated ones and the changes, which grow; counted as ``wc -w`` does."""
    read = [p for p in PAGES if "evidence" not in p.parts and p.name != "changelog.md"]
    words = {page.name: len(page.read_text().split()) for page in read}
    assert {name: count for name, count in words.items() if count > MOST_WORDS} == {}


def test_every_page_is_in_the_list_of_pages() -> None:
    """Or in a folder that is, as the decisions are."""
    text = text_of("docs/README.md")
    listed = {
        ROOT / "docs" / path for path in re.findall(r"^\| ?\[.*?\]\(([^)#]+)\) ?\|", text, re.M)
    }
    missing = {page for page in PAGES[1:] if not listed & {page, *page.parents}}
    assert missing == {ROOT / "docs" / "README.md"}


def test_every_page_of_evidence_is_in_its_list() -> None:
    text = text_of("docs/evidence/README.md")
    listed = re.findall(r"^\| ?\[.*?\]\(([^)#]+)\) ?\|", text, re.M)
    pages = {page.name for page in (ROOT / "docs" / "evidence").glob("*.md")}
    assert sorted(listed) == sorted(pages - {"README.md"})


def test_measured_parts_are_filled() -> None:
    empty = r"<!-- measured: [^>]*-->\n<!-- end -->"
    assert [name_of(page) for page in PAGES if re.search(empty, page.read_text())] == []


def test_settings_that_are_named_exist() -> None:
    sections = "|".join({path.split(".")[0] for path in fields()})
    groups = {key.rpartition(".")[0] for key in REPORT_KEYS}
    known = {*fields(), *REPORT_KEYS, *groups}
    for page in PAGES:
        named = set(re.findall(rf"`((?:{sections})\.[a-z_]+)(?:[=:.][^`]*)?`", page.read_text()))
        assert sorted(named - known) == [], name_of(page)


def test_commands_that_are_named_exist() -> None:
    for page in PAGES:
        named = set(re.findall(r"`haptic-wall ([a-z]+)", page.read_text()))
        assert sorted(named - {*COMMANDS}) == [], name_of(page)


def test_names_that_are_imported_in_examples_exist() -> None:
    for page in [*PAGES, *sorted((ROOT / "docs" / "examples").glob("*.py"))]:
        for module, names in _IMPORTED.findall(page.read_text(encoding="utf-8")):
            there = importlib.import_module(module)
            for name in re.findall(r"\w+", names):
                found = hasattr(there, name) or importlib.util.find_spec(f"{module}.{name}")
                assert found, f"{name_of(page)}: {module}.{name}"


def test_names_with_an_underscore_are_those_of_the_sources() -> None:
    """Functions, fields and files; decisions, evidence and changes also name what has gone."""
    kinds = {".py", ".js", ".yaml", ".html", ".toml", ".conf"}
    rooms = ("controller", "hw", "scripts", "src", "docs/examples", "tests")
    files = [file for room in rooms for file in (ROOT / room).rglob("*") if file.suffix in kinds]
    known = {word for file in files for word in re.findall(r"\w+", file.read_text("utf-8"))}
    for page in PAGES:
        if page.parent.name in ("decisions", "evidence", "xl330-pendulum") or page == CHANGES:
            continue
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        named = set(re.findall(r"`(?:\w+\.)*([A-Za-z]*_[a-z_]+)`", text))
        lost = sorted(named - known)
        assert lost == [], name_of(page)


def keys(value: object, path: str = "") -> set[str]:
    """The keys of a report, by path; times and lists are one key."""
    if not isinstance(value, dict) or "p50" in value:
        return {path}
    inner = {key for name, v in value.items() for key in keys(v, f"{path}.{name}".lstrip("."))}
    return inner | ({path} if path else set())


@pytest.mark.usefixtures("folder")
def test_every_key_of_the_report_is_explained(cli: Cli) -> None:
    words = ["run", "emulated-ideal", "--set=loop.clock=simulated", "--duration=0.1"]
    found = keys(cli.json(*words))
    groups = {"guard.requested", "guard.commanded", "oscillation.reduced_to", "torque"}
    limits = {key for key in found if key.startswith("guard.limit.")}
    assert found - groups - limits | {"axes"} == {*REPORT_KEYS}


def test_every_column_of_the_log_is_explained() -> None:
    page = text_of("docs/how-to/logs.md")
    rows = re.findall(r"^\| ?`(\w+)` ?\| ?`(\w+)` ?\|", page, re.M)
    assert dict(rows) == COLUMNS
    assert set(not_none(ROW.names)) == set(COLUMNS.values())


def test_the_version_is_that_of_changes_and_citation() -> None:
    cited = yaml.safe_load(text_of("CITATION.cff"))
    newest = re.findall(r"^## ([\d.]+), ([\d-]+)$", text_of("docs/changelog.md"), re.M)[0]
    assert (cited["version"], str(cited["date-released"])) == newest
    assert newest[0] == haptic_wall.__version__


def test_every_start_up_check_is_explained() -> None:
    two = ["loop.clock=simulated", "axes={one: {servo: {id: 1}}, two: {servo: {id: 2}}}"]
    bus = open_bus(load_config("emulated-ideal", two).config.servos(), SimulatedClock())
    try:
        checks = bus.start()[0]
    finally:
        bus.close()
    page = text_of("docs/reference/start-up.md").partition("|check|wanted")[2]
    table = page.partition("\n\n")[0]
    assert re.findall(r"^\| ?([a-z][\w -]*?) ?\|", table, re.M) == [check.name for check in checks]
