"""How Sphinx makes the site; ``build.py`` gathers its sources, and checks what it made."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

from rotorid import __version__

project = "rotorid"
author = copyright = "The rotorid developers"
release = version = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "myst-nb"}
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_dmath_double_inline = True
myst_heading_anchors = 6
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
html_theme = "furo"
html_title = "rotorid"
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True
# A face and the module behind it show the same object, and readers look it up by its face.
suppress_warnings = ["ref.python", "myst.strikethrough"]


def _inline(self: Any, node: nodes.math) -> None:
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Mathematics as MathML, which every browser shows without a script and without a network."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
