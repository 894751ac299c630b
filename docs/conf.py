"""Configuration of Sphinx for the website: scripts/website."""

project = "haptic-wall"
extensions = ["myst_parser"]
root_doc = "index"
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
html_theme = "alabaster"
html_theme_options = {"page_width": "80em", "sidebar_width": "16em"}
myst_heading_anchors = 4
suppress_warnings = ["myst.xref_missing", "myst.header"]  # links to folders and sources
