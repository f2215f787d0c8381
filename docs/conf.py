"""The documentation as a site: `make docs` builds it into site/."""

from importlib.metadata import version as version_of

project = "massid"
author = "The massid authors"
version = release = version_of("massid")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinxcontrib.mermaid",
]
exclude_patterns = ["images"]
myst_enable_extensions = ["colon_fence"]
myst_fence_as_directive = ["mermaid"]
myst_heading_anchors = 4
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
html_theme = "furo"
html_title = "massid"
html_copy_source = False
html_show_sphinx = html_show_copyright = False
highlight_language = "none"
