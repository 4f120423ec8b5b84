"""The documentation site; `make docs` builds it into runs/site."""

import sys
from importlib.resources import files
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project = "rimless-gym"
author = "the rimless-gym authors"
copyright = f"2026, {author}. MIT licence"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "scripts.studies.documents.site",
]
smartquotes_action = "D"  # dashes alone: phi' is a rate
highlight_language = "text"  # of blocks that name none

# Markdown, as code-hosting sites read it
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # the notebook's pictures are stored in it; the tests execute it

# docstrings: what stands in single backticks is a name, and a link where that name is documented
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_type_aliases = {
    name: name for name in ("Act", "Array", "Controller", "Floats", "Machine", "Policy")
}
autodoc_preserve_defaults = True  # names, such as BUILDABLE, instead of what they stand for
napoleon_custom_sections = [("Attributes", "params_style")]  # lists, not headings
napoleon_use_rtype = False
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries_show_parents = "hide"

# MathJax as one file, so that the site needs no network
html_static_path = [str(files("mathjax") / "static/mathjax/es5/tex-svg.js")]
mathjax_path = "tex-svg.js"
html_theme = "furo"
html_theme_options = {"light_css_variables": {"code-font-size": "76%"}}  # lines of 95 characters
html_title = "rimless-gym"
html_show_sourcelink = False
html_copy_source = False
