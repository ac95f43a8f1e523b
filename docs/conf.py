"""Sphinx: the documentation in Markdown, the library from docstrings, the commands from click."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

project = "taction"
author = "the taction developers"
copyright = "the taction developers, GPL-3.0-or-later"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
html_theme = "alabaster"
html_theme_options = {
    "description": "SPICE netlists and analog verification of regularising networks",
    "page_width": "68rem",
    "sidebar_width": "15rem",
}
html_static_path: list[str] = []
html_title = "taction"
