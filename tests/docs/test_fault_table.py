"""The fault table is what the program does now."""

from pathlib import Path

from scripts.fault_table import FAULTS, as_row, lines, page

PAGE = Path(__file__).parents[2] / "docs" / "fault-table.md"
SOME = ("drop:times=1,way=reply", "drop:way=reply", "jump:counts=500", "unplug-adapter")


def test_the_page_is_what_a_rehearsal_finds(thorough):
    text = PAGE.read_text()
    if thorough:
        (machine,) = (line for line in text.splitlines() if line.startswith("This page: "))
        assert text == page(machine), "run scripts/fault_table"
        return
    rows = map(as_row, lines([fault for fault in FAULTS if fault[1] in SOME]))
    assert [row for row in rows if row not in text] == [], "run scripts/fault_table"
    assert [spec for _, spec in FAULTS if f"`{spec}`" not in text] == []
