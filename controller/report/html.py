"""Makes self-contained HTML pages: fills a template and embeds the pictures."""

from __future__ import annotations

import base64
from importlib.resources import files
from typing import Any


def filled_in(package: str, **values: Any) -> str:  # noqa: ANN401 - whatever the template shows
    """Return the text of a page: the template ``page.html.j2`` of a package, filled with values.

    Args:
        package: The package that the template lies in.
        values: By the names that the template knows them by; text is escaped.

    Raises:
        jinja2.UndefinedError: The template names a value that is not given.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = files(package).joinpath("page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(**values)


def embedded(png: bytes) -> str:
    """Return a picture as a data URL for a page."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
