"""The website: every page is in its navigation, in the order of the list of pages; every link leads
somewhere; pages look as on GitHub.
"""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from scripts import website
from tests.docs.pages import PAGES, ROOT

SECTIONS = ["Start", "Your servo", "How to", "Concepts", "Reference", "Theory and paper"]
SECTIONS += ["Evidence", "Decisions"]


def test_the_navigation_has_every_page_once_in_the_order_of_the_list() -> None:
    sections = website.navigation()
    assert list(sections) == SECTIONS
    assert [entry.title for entry in sections["Start"]][:2] == ["README", "tutorial"]
    paths = [entry.path for entries in sections.values() for entry in entries]
    paths.remove("docs/examples/first-hour.ipynb")
    assert sorted(paths) == sorted(
        page.relative_to(ROOT).as_posix() for page in PAGES if page != ROOT / website.INDEX
    )


@pytest.mark.parametrize(
    ("link", "found"),
    [
        ("[a](b.md)", []),
        ("[a](b.md#two-words)", []),
        ("[a](#here)", []),
        ("[a](https://example.org/c.md#d)", []),
        ("`[a](c.md)`", []),
        ("[a](c.md)", ["c.md"]),
        ("[a](b.md#three)", ["b.md#three"]),
        ("![a](c.png)", ["c.png"]),
    ],
)
def test_a_link_that_leads_nowhere_is_found(tmp_path: Path, link: str, found: list[str]) -> None:
    page = tmp_path / "a.md"
    page.write_text(f"# Here\n\n{link}\n")
    (tmp_path / "b.md").write_text("## Two `words`\n")
    assert website.broken(page) == found


def test_a_page_is_rendered_as_github_does(tmp_path: Path) -> None:
    pytest.importorskip("markdown_it")
    page = tmp_path / "a.md"
    (tmp_path / "c.py").touch()
    (tmp_path / "folder").mkdir()
    text = "# A\n\n## K and `B`\ntext\n1. one\n   - [b](b.md#x), [c](c.py), [d](folder)\n"
    got, headings = website.rendered(text, page)
    assert '<h2 id="k-and-b">' in got
    assert re.search(r"<ol>\s*<li>one\s*<ul>\s*<li>", got)
    links = re.findall(r'href="([^"]*)"', got)
    assert links == ["b.html#x", "c.py", "folder/index.html"]
    assert [each["name"] for each in headings[0]["children"]] == ["K and B"]


@pytest.mark.whole
@pytest.mark.filterwarnings("default")  # those of MkDocs are not ours
def test_every_link_of_the_built_website_leads_somewhere(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    pytest.importorskip("markdown_it")
    out = tmp_path / "website"
    website.build(out)
    texts = {page: page.read_text() for page in out.rglob("*.html") if page.name != "404.html"}
    names = {page: set(re.findall(r' id="([^"]+)"', text)) for page, text in texts.items()}
    assert len(texts) > len(PAGES)
    wrong = []
    for page, text in texts.items():
        for target in re.findall(r'(?:href|src)="([^"]+)"', text):
            if re.match(r"[a-z]+:|//", target):
                continue
            path, _, anchor = target.partition("#")
            there = (page.parent / unquote(path.partition("?")[0])).resolve() if path else page
            known = there not in names or unquote(anchor) in {"", *names[there]}
            if not there.exists() or not known:
                wrong.append(f"{page.relative_to(out)}: {target}")
    assert wrong == []
