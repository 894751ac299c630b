"""Builds the pages of README.md and docs/ as a website.

    scripts/website [--out DIR]

The navigation is read from the tables of docs/README.md. The pages are copied with what they link
to, a folder as a page that lists its files, a source file as a text. They are rendered as GitHub
renders them (CommonMark and tables), inside a plain theme of MkDocs. A link that leads nowhere
ends it with status 1.
"""

from __future__ import annotations

import argparse
import html
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

ROOT: Final = Path(__file__).resolve().parent.parent
INDEX: Final = "docs/README.md"
NOTEBOOK: Final = ".ipynb"
_ROW: Final = re.compile(r"^\| \[(.+?)\]\(([^)#]+)\) \|", re.M)
_LINK: Final = re.compile(r"\]\(([^)\s]+)\)")
_SHOWN: Final = (".png", ".gif", ".md", ".csv", ".json", ".ipynb")
"""Files that a browser shows, or that are fetched, as they are; others get the ending .txt"""

_CSS: Final = "pages.css"
_STYLE: Final = """\
.wy-nav-content { max-width: 62rem; }
.rst-content table td, .rst-content table th { white-space: normal !important; }
.rst-content img { max-width: 100%; }
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """A page of the navigation."""

    title: str
    path: str
    """From the project's folder"""


def navigation(root: Path = ROOT) -> dict[str, list[Entry]]:
    """Return the pages of each section of docs/README.md; a folder stands for its pages."""
    found: dict[str, list[Entry]] = {}
    for part in re.split(r"^## ", (root / INDEX).read_text(encoding="utf-8"), flags=re.M)[1:]:
        rows = _ROW.findall(part)
        if rows:
            found[part.splitlines()[0]] = [
                entry for title, target in rows for entry in _entries(root, title, target)
            ]
    return found


def _entries(root: Path, title: str, target: str) -> Iterator[Entry]:
    path = (root / INDEX).parent.joinpath(target).resolve()
    if not path.is_dir():
        yield Entry(title, path.relative_to(root).as_posix())
        return
    for page in sorted(path.glob("*.md")):
        yield Entry(heading(page), page.relative_to(root).as_posix())


def pages_of(root: Path) -> list[Path]:
    """Return README.md and all pages of docs/."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def heading(page: Path) -> str:
    """Return the first heading of a page."""
    found = re.search(r"^# (.*)$", page.read_text(encoding="utf-8"), re.M)
    return found[1].replace("`", "") if found else page.stem


def slug(text: str) -> str:
    """Return the anchor that GitHub makes of a heading."""
    return re.sub(r"[^\w -]", "", text.lower()).replace(" ", "-")


def without_code(text: str) -> str:
    """Return a page without its code, in which nothing is a link."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^ *```.*?^ *```", "", text, flags=re.S | re.M))


def broken(page: Path) -> list[str]:
    """Return the links of a page that lead to no file, or to no heading."""
    found = []
    for target in _LINK.findall(without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / unquote(path)).resolve() if path else page
        if not there.exists() or (anchor and anchor not in _anchors(there)):
            found.append(target)
    return found


def _anchors(page: Path) -> set[str]:
    if page.suffix != ".md":
        return set()
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {slug(each) for each in headings}


def stage(folder: Path, root: Path = ROOT) -> None:
    """Copy the pages and all that they link to.

    Args:
        folder: Empty.
        root: The project's folder.
    """
    pages = pages_of(root)
    for page in pages:
        _copy(page, folder, root)
    for page in pages:
        for target in _LINK.findall(without_code(page.read_text(encoding="utf-8"))):
            path = target.partition("#")[0]
            if path and not re.match(r"[a-z]+:", path):
                there = (page.parent / unquote(path)).resolve()
                if there.is_dir():
                    _list(there, folder, root)
                elif there.is_file():
                    _copy(there, folder, root)


def _copy(file: Path, folder: Path, root: Path) -> None:
    to = folder / file.relative_to(root)
    to = to if to.suffix in _SHOWN else to.with_name(f"{to.name}.txt")
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, to)
    if file.suffix == NOTEBOOK:
        to.with_suffix(".md").write_text(text_of_notebook(file), encoding="utf-8")


def text_of_notebook(notebook: Path) -> str:
    """Return the cells of a notebook and their output as a page."""
    found = [f'<a href="{notebook.name}">This page as a notebook</a>']
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        found.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for output in cell.get("outputs", ()):
            if "text" in output:
                found.append(f"```text\n{''.join(output['text'])}```")
            elif "data" in output:
                picture = "".join(output["data"]["image/png"].split())
                found.append(
                    f'<img alt="position and torque" src="data:image/png;base64,{picture}">'
                )
    return "\n\n".join(found) + "\n"


def _list(there: Path, folder: Path, root: Path) -> None:
    """Make the page of a folder, and copy its files."""
    if (there / "README.md").exists():
        return
    name = there.relative_to(root).as_posix()
    lines = [f"# {name}", ""]
    for file in sorted(there.iterdir()):
        if file.is_file() and not file.name.startswith("."):
            _copy(file, folder, root)
            title = heading(file) if file.suffix == ".md" else file.name
            lines.append(f"- [{title}]({file.name})")
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / "README.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def place_of(target: str, page: Path) -> str:
    """Return where a link of a page leads on the website.

    Args:
        target: As the page has it.
        page: In the folder of ``stage``.
    """
    if re.match(r"[a-z]+:", target) or target.startswith("#"):
        return target
    path, hash_, anchor = target.partition("#")
    there = page.parent / unquote(path)
    if there.is_dir():
        return f"{path.rstrip('/')}/index.html"
    if path.endswith((".md", NOTEBOOK)):
        folder, _, name = path.rpartition("/")
        name = "index.html" if name == "README.md" else f"{Path(name).stem}.html"
        return f"{folder}/{name}{hash_}{anchor}" if folder else f"{name}{hash_}{anchor}"
    return path if there.exists() else f"{path}.txt"


def rendered(text: str, page: Path) -> tuple[str, list[Any]]:
    """Return a page as HTML, and its headings as MkDocs takes them.

    Args:
        text: CommonMark with tables.
        page: In the folder of ``stage``.
    """
    from markdown_it import MarkdownIt

    parser = MarkdownIt("commonmark", {"html": True}).enable("table")
    tokens = parser.parse(text)
    headings: list[Any] = []
    for n, token in enumerate(tokens):
        if token.type == "heading_open":
            words = "".join(part.content for part in tokens[n + 1].children or ())
            token.attrSet("id", slug(words))
            name = html.escape(words)
            level = int(token.tag[1])
            headings.append({"level": level, "id": slug(words), "name": name, "children": []})
        for part in token.children or ():
            for name in ("href", "src"):
                if target := part.attrGet(name):
                    part.attrSet(name, place_of(str(target), page))
    answer: str = parser.renderer.render(tokens, parser.options, {})
    top = headings[:1]
    for each in headings[1:]:
        if each["level"] == 2:
            top[0]["children"].append(each)
    return answer, top


def on_page_markdown(*_: Any, **__: Any) -> str:  # noqa: ANN401 - called by MkDocs
    """Return nothing for MkDocs to render."""
    return ""


def on_page_content(_html: str, page: Any, **_: Any) -> str:  # noqa: ANN401 - called by MkDocs
    """Return a page as GitHub renders it, in place of MkDocs' own rendering."""
    from mkdocs.structure.toc import get_toc

    path = Path(page.file.abs_src_path)
    answer, headings = rendered(path.read_text(encoding="utf-8"), path)
    page.toc = get_toc(headings)
    return answer


def build(out: Path, root: Path = ROOT) -> None:
    """Build the website.

    Args:
        out: A folder; what is in it is replaced.
        root: The project's folder.
    """
    from mkdocs.commands.build import build as mkdocs_build
    from mkdocs.config import load_config

    sections = navigation(root)
    with tempfile.TemporaryDirectory() as place:
        pages = Path(place) / "pages"
        stage(pages, root)
        (pages / _CSS).write_text(_STYLE, encoding="utf-8")
        (Path(place) / "mkdocs.yml").write_text("site_name: haptic-wall\n", encoding="utf-8")
        config = load_config(
            config_file=str(Path(place) / "mkdocs.yml"),
            docs_dir=str(pages),
            site_dir=str(out),
            use_directory_urls=False,
            extra_css=[_CSS],
            theme={"name": "readthedocs", "highlightjs": False, "navigation_depth": 2},
            hooks=[__file__],
            markdown_extensions=[],
            nav=[
                {name: [{entry.title: entry.path.replace(NOTEBOOK, ".md")} for entry in entries]}
                for name, entries in sections.items()
            ],
            validation={
                "nav": {"omitted_files": "ignore"},
                "links": {
                    "not_found": "ignore",
                    "anchors": "ignore",
                    "unrecognized_links": "ignore",
                },
            },
        )
        mkdocs_build(config)


def main(words: list[str] | None = None) -> int:
    """Build the website; return the exit status."""
    parser = argparse.ArgumentParser(prog="scripts/website", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "website", metavar="DIR")
    out = parser.parse_args(words).out
    if out.exists() and any(out.iterdir()) and not (out / "search").is_dir():
        print(f"--out {out}: found a folder with other files; name an empty one", file=sys.stderr)
        return 2
    pages = pages_of(ROOT)
    wrong = [f"{page.relative_to(ROOT)}: {link}" for page in pages for link in broken(page)]
    for each in wrong:
        print(f"found a link that leads nowhere: {each}", file=sys.stderr)
    build(out.resolve())
    print(f"open {out / 'index.html'}; to search in it: python3 -m http.server -d {out}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
