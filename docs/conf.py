"""Sphinx: documentation in Markdown, notebooks that run, the library from docstrings, commands."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

# The kernels of the notebooks have their own folders, not the user's, and talk on loopback only,
# of which they need not warn.
SCRATCH = tempfile.mkdtemp(prefix="docs-")
atexit.register(shutil.rmtree, SCRATCH, ignore_errors=True)
os.environ |= {
    "JUPYTER_RUNTIME_DIR": SCRATCH,
    "IPYTHONDIR": SCRATCH,
    "JUPYTER_PREFER_ENV_PATH": "1",
}
PROFILE = Path(SCRATCH) / "profile_default"
PROFILE.mkdir()
(PROFILE / "ipython_kernel_config.py").write_text("get_config().IPKernelApp.log_level = 40\n")

project = "taction"
author = "the taction developers"
copyright = "the taction developers, GPL-3.0-or-later"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated",
    "typed",
]
source_suffix = {".md": "myst-nb"}
exclude_patterns = ["_build", "_generated/notebooks"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "force"  # every build runs the notebooks: their pictures are of this code
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 300  # s, of a cell on a busy machine
nb_merge_streams = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
smartquotes = False  # "--" in a message is an option
html_theme = "alabaster"
html_theme_options = {
    "page_width": "68rem",
    "sidebar_width": "15rem",
}
templates_path = ["_templates"]
html_sidebars = {"**": ["menu.html"]}
html_static_path = ["_static"]
html_css_files = ["taction.css"]
html_title = "taction"
