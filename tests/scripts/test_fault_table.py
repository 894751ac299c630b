"""The fault table is what the program does now."""

from scripts.studies.fault_table import FAULTS, STUDY, line
from scripts.study import table
from tests.docs.pages import text_of
from tests.scripts.computed import stale

SOME = ("drop:way=reply", "jump:counts=500")
MORE = ("drop:times=1,way=reply", "unplug-adapter")


def test_the_page_is_what_a_session_in_memory_finds(thorough: bool, wholly: bool) -> None:
    if thorough:
        assert stale(STUDY) == [], "run scripts/study fault_table"
        return
    text = text_of("docs/evidence/fault-table.md")
    some = SOME + MORE if wholly else SOME
    rows = table([], *(line(fault) for fault in FAULTS if fault[1] in some))[2:]
    assert [row for row in rows if row not in text] == [], "run scripts/study fault_table"
    assert [spec for _, spec in FAULTS if f"`{spec}`" not in text] == []
