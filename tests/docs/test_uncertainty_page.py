"""The tables of docs/uncertainty.md are what the program computes."""

from scripts.uncertainty import PAGE, PART, corner, costs, renewed


def test_the_tables_are_what_is_computed(thorough):
    text = PAGE.read_text()
    tables = {"costs": costs} | ({"corner": lambda: corner(200)} if thorough else {})
    assert {found[2] for found in PART.finditer(text)} == {"costs", "corner"}
    assert renewed(text, tables) == text, "run scripts/uncertainty"
