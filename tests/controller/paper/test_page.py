"""All items as files, and the page that shows them: pictures, words, links, the CSV's numbers."""

from __future__ import annotations

import csv
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray

from haptic_wall.controller.paper.items import ITEMS, Made, make
from haptic_wall.controller.paper.numbers import HEADINGS
from haptic_wall.controller.paper.page import write_page
from haptic_wall.controller.theory import critical_stiffness


def simulated(
    virtual_damping: NDArray[np.float64], delay: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stands in for the simulation, which has tests of its own."""
    return 1.00001 * critical_stiffness(1.0, 0.1, virtual_damping, 1e-3, delay)


@pytest.fixture(scope="module")
def made(
    undrawn: None,  # noqa: ARG001 - what it draws
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, list[Made]]:
    folder = tmp_path_factory.mktemp("paper")
    return folder, [make(item.name, folder, simulated) for item in ITEMS]


@pytest.fixture(scope="module")
def page(made: tuple[Path, list[Made]]) -> Page:
    folder, items = made
    reader = Page()
    reader.feed(write_page(items, folder).read_text(encoding="utf-8"))
    reader.close()
    return reader


class Page(HTMLParser):
    """What a reader gets: links, images, identifiers, and the tables of each section."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.images: dict[str, Any] = {}
        self.ids: list[str] = []
        self.open: list[str] = []
        self.tables: dict[Any, Any] = {}
        self.section: Any = None
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given: dict[str, Any] = dict(attrs)
        if tag not in ("meta", "img", "link"):
            self.open.append(tag)
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "section":
            self.section = given["id"]
        elif tag == "a":
            self.links.append(given["href"])
        elif tag == "img":
            self.images[given["src"]] = given["alt"]
        elif tag == "table":
            self.tables[self.section] = []
        elif tag == "tr":
            self.tables[self.section].append([])

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.tables[self.section][-1].append(data)


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_items_are_those_of_the_paper() -> None:
    names = ["table2", "fig3", "fig4", "fig5", "fig6", "fig8", "fig9", "fig10"]
    assert [item.name for item in ITEMS] == names


@pytest.mark.whole
@pytest.mark.parametrize("name", [item.name for item in ITEMS])
def test_pictures_are_large_enough_to_print_and_not_blank(
    made: tuple[Path, list[Made]], name: str
) -> None:
    folder, _ = made
    pixels = imread(folder / f"{name}.png")[:, :, :3]
    assert pixels.shape[1] >= 1000  # 300 dots per inch over a journal's column
    drawn = (pixels < 0.95).any(axis=2)
    assert 0.01 < drawn.mean() < 0.7
    # something in every quarter; no curve of one colour alone
    for half in np.array_split(drawn, 2):
        for quarter in np.array_split(half, 2, axis=1):
            assert quarter.mean() > 0.005
    assert (np.ptp(pixels, axis=2) > 0.2).mean() > 0.001


@pytest.mark.whole
@pytest.mark.parametrize("name", ["table2", "fig6"])
def test_the_same_data_give_the_same_files(
    made: tuple[Path, list[Made]], tmp_path: Path, name: str
) -> None:
    folder, _ = made
    again = make(name, tmp_path, simulated)
    for path in (again.csv, again.png):
        assert path.read_bytes() == (folder / path.name).read_bytes()


def test_the_page_shows_every_item_in_order(page: Page) -> None:
    names = [item.name for item in ITEMS]
    assert page.ids == names
    assert list(page.images) == [f"{name}.png" for name in names]
    assert page.open == []
    text = " ".join(" ".join(page.text).split())
    for item in ITEMS:
        for part in (item.title, item.shows, item.remark):
            assert part in text
        assert page.images[f"{item.name}.png"] == item.alternative
        assert len(item.alternative) > 60


def test_every_link_leads_somewhere(made: tuple[Path, list[Made]], page: Page) -> None:
    folder, _ = made
    for link in page.links:
        if link.startswith("#"):
            assert link[1:] in page.ids
        else:
            assert (folder / link).is_file(), link
    for item in ITEMS:
        assert {f"#{item.name}", f"{item.name}.csv", f"{item.name}.png"} <= set(page.links)


def test_the_numbers_of_table_ii_are_those_of_its_csv(
    made: tuple[Path, list[Made]], page: Page
) -> None:
    folder, _ = made
    _, *shown = page.tables["table2"]
    held = rows_of(folder, "table2")
    assert len(shown) == len(held) == 36
    for cells, row in zip(shown, held, strict=True):
        for cell, value in zip(cells, row.values(), strict=True):
            half = 0.5 * 10.0 ** -len(cell.partition(".")[2])
            assert float(cell) == pytest.approx(float(value), abs=1.001 * half)
    worst = max(held, key=lambda row: abs(float(row["theory_error_percent"])))
    assert f"worst by theory: {float(worst['theory_error_percent']):+.4f} %" in "".join(page.text)


@pytest.mark.parametrize("name", ["fig3", "fig5", "fig9", "fig10"])
def test_the_numbers_of_a_figure_are_those_of_its_csv(
    made: tuple[Path, list[Made]], page: Page, name: str
) -> None:
    folder, _ = made
    head, *shown = page.tables[name]
    held = [row for row in rows_of(folder, name) if row["kind"] in ("peak", "error point")]
    assert len(shown) == len(held) > 0
    columns = [next(key for key in held[0] if HEADINGS.get(key) == title) for title in head]
    for cells, row in zip(shown, held, strict=True):
        assert cells[0] == row[columns[0]]
        for cell, column in zip(cells[1:], columns[1:], strict=True):
            assert float(cell) == pytest.approx(float(row[column]), rel=0.6e-4)
