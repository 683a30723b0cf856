"""Sphinx configuration of the pages: `sphinx-build -W docs build/docs`, then open build/docs/index.html."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1]))  # for `analysis`, which is not installed
import generate

import workbench

generate.write(Path(__file__).parent / "_generated")

project = "workbench"
release = workbench.__version__
copyright = ""
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",  # copies MathJax into the pages
]  # fmt: skip
myst_enable_extensions = ["dollarmath"]
root_doc = "index"
exclude_patterns = ["_tables"]  # which pages include
myst_heading_anchors = 3
autodoc_typehints = "none"  # docstrings give shapes and units
default_role = "code"
html_theme = "furo"  # includes its scripts and styles; pages load nothing from a network
html_title = "workbench"
html_show_copyright = html_show_sphinx = html_copy_source = False
highlight_language = "text"
