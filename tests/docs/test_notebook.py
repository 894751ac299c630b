"""The notebook of the tutorial: made from it, small, and what it shows is what its cells say."""

from typing import Any

import pytest

from scripts import notebook


def said(outputs: list[dict[str, Any]]) -> str:
    """Return what a cell printed."""
    return "".join("".join(each["text"]) for each in outputs if each["output_type"] == "stream")


def test_it_is_made_from_the_tutorial() -> None:
    held = [(cell["cell_type"], notebook.source(cell)) for cell in notebook.held()]
    assert held == notebook.cells(), "run .venv/bin/python -m scripts.notebook"
    assert sum(kind == "code" for kind, _ in held) == 7


def test_it_is_small_and_names_no_machine() -> None:
    text = notebook.NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < 120_000
    for path in ("/home/", "/tmp/", "/work/", "/root/", "/usr/", str(notebook.ROOT)):
        assert path not in text


@pytest.mark.whole
@pytest.mark.filterwarnings("default")  # those of the kernel are not ours
def test_its_cells_say_what_it_shows() -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    shown = [cell["outputs"] for cell in notebook.held() if cell["cell_type"] == "code"]
    found = notebook.executed()
    assert [said(outputs) for outputs in found] == [said(outputs) for outputs in shown]
    assert "ended by trip:oscillation" in said(found[2])
    kinds = [[each["output_type"] for each in outputs] for outputs in found]
    assert kinds == [[], *[["stream", "display_data"]] * 6]
