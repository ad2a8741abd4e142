"""Configuration of the documentation; ``sphinx-build -W docs docs/_build/html`` needs no network."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import starplumb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))


def mathjax() -> Path:
    """MathJax as one file, from the package that carries it."""
    spec = find_spec("sphinx-mathjax-offline")
    if spec is None or spec.origin is None:
        raise ImportError("sphinx-mathjax-offline is missing: pip install 'starplumb[docs]'")
    return Path(spec.origin).parent / "static" / "mathjax" / "tex-svg.js"


project = "starplumb"
author = "The starplumb developers"
release = version = starplumb.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "executed",
    "generated",
    "notebook",
    "signatures",
]
if find_spec("sphinx_copybutton"):  # a convenience: without it the pages are the same but for their buttons
    extensions.append("sphinx_copybutton")
copybutton_prompt_text = r"\$ |> "
copybutton_prompt_is_regexp = True
copybutton_exclude = ".linenos, .gp"
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "fieldlist"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "_ext", "generated/extra"]

autodoc_member_order = "bysource"
python_maximum_signature_line_length = 80
autodoc_default_options = {"members": True}
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Epochs", "Index", "Mask")}
add_module_names = False

html_theme = "pydata_sphinx_theme"
html_title = f"starplumb {release}"
html_static_path = [str(mathjax()), "_static"]
html_css_files = ["starplumb.css"]
html_extra_path = ["generated/extra"]
html_show_sourcelink = False
html_copy_source = False
mathjax_path = "tex-svg.js"
html_theme_options = {
    "navigation_with_keys": False,
    "show_prev_next": True,
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_toc_level": 2,
}
copyright = "The starplumb developers, Apache-2.0"
