"""The notebook of the tutorial is small, and what it shows is what its cells say."""

from typing import Any

import pytest

from tests.docs.pages import ROOT

NOTEBOOK = ROOT / "docs" / "examples" / "first-hour.ipynb"


def said(notebook: Any) -> list[str]:
    """Return what each cell printed."""
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [[each for each in cell.outputs if each.get("name") == "stdout"] for cell in cells]
    return ["".join("".join(each["text"]) for each in some) for some in outputs]


def test_it_is_small_and_names_no_machine() -> None:
    text = NOTEBOOK.read_text()
    assert len(text) < 120_000
    for path in ("/home/", "/tmp/", "/root/", "/usr/", str(ROOT)):
        assert path not in text


@pytest.mark.whole
@pytest.mark.filterwarnings("default")  # those of the kernel are not ours
def test_its_cells_say_what_it_shows() -> None:
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    shown = said(notebook)
    client.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    assert said(notebook) == shown, "run jupyter execute --inplace docs/examples/first-hour.ipynb"
    assert "ended by trip:oscillation" in shown[2]
