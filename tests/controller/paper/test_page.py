"""All items as files, and the page that shows them: pictures, words, links, the CSV's numbers."""

from __future__ import annotations

import csv
import re
from html import unescape
from pathlib import Path

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
def page(made: tuple[Path, list[Made]]) -> str:
    folder, items = made
    return unescape(write_page(items, folder).read_text(encoding="utf-8"))


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
def test_the_page_shows_every_item_with_its_files(made: tuple[Path, list[Made]], page: str) -> None:
    folder, _ = made
    text = " ".join(page.split())
    assert re.findall(r'<section id="(\w+)"', page) == [item.name for item in ITEMS]
    for item in ITEMS:
        for part in (item.title, item.shows, item.remark, item.alternative):
            assert part in text
        assert len(item.alternative) > 60
    links = set(re.findall(r'(?:href|src)="(\w+\.\w+)"', page))
    assert links >= {f"{item.name}.{kind}" for item in ITEMS for kind in ("csv", "png")}
    assert all((folder / link).is_file() for link in links)


@pytest.mark.whole
@pytest.mark.parametrize("name", ["table2", "fig3", "fig9"])
def test_the_numbers_of_the_page_are_those_of_the_csv(
    made: tuple[Path, list[Made]], page: str, name: str
) -> None:
    folder, _ = made
    section = page.partition(f'<section id="{name}"')[2].partition("</section>")[0]
    head, *shown = (
        re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL)
        for row in re.findall(r"<tr>.*?</tr>", section, re.DOTALL)
    )
    held = [row for row in rows_of(folder, name) if row.get("kind", "peak") == "peak"]
    assert len(shown) == len(held) > 0
    columns = list(held[0])
    if name != "table2":
        columns = [next(key for key in held[0] if HEADINGS.get(key) == title) for title in head]
    for cells, row in zip(shown, held, strict=True):
        for cell, column in zip(cells, columns, strict=True):
            if column != "kind":
                half = 0.5 * 10.0 ** -len(cell.partition(".")[2])
                assert float(cell) == pytest.approx(float(row[column]), rel=0.6e-4, abs=half)
