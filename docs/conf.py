"""Settings of the documentation site: `make docs` builds it into docs/_build/html."""

import re
import sys
from pathlib import Path

from torquebench import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

project = "torquebench"
author = "The torquebench developers"
copyright = "the torquebench developers, MIT licence"  # noqa: A001 - Sphinx's name
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "mermaid",
    "generated_pages",
]
exclude_patterns = ["_build", "gallery", "images/**/*.md"]
root_doc = "index"
templates_path = ["_templates"]

myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline", "colon_fence"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]

autodoc_typehints = "none"
autodoc_default_options = {"members": True}
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

nitpicky = False
html_theme = "furo"
html_title = f"torquebench {version}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}
html_copy_source = False
html_show_sourcelink = False
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
suppress_warnings = ["config.cache"]

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "image_scrapers": ("gallery_svg.svg_figures",),
    "abort_on_example_error": True,
    "write_computation_times": False,
    "remove_config_comments": True,
    "plot_gallery": "True",
    "min_reported_time": 1e9,
    "within_subsection_order": "FileNameSortKey",
    "show_signature": False,
}


def _escape_bars(_app, what, _name, _obj, _options, lines):  # type: ignore[no-untyped-def]
    """Escape magnitudes such as |error|, which reStructuredText takes for substitutions."""
    lines[:] = [
        line
        if line.lstrip().startswith((">>>", "..."))
        else re.sub(r"\|(?=\S[^|]*\|)|(?<=\S)\|", r"\\|", line)
        for line in lines
    ]


def _skip(_app, _what, name, _obj, _skip, _options):  # type: ignore[no-untyped-def]
    """Leave out what scikit-learn adds to every estimator for its own routing."""
    added = name.startswith("set_") and name.endswith("_request")
    return True if added or name == "model_config" else None


def setup(app):  # type: ignore[no-untyped-def]
    """Connect what changes docstrings."""
    app.connect("autodoc-process-docstring", _escape_bars, priority=400)
    app.connect("autodoc-skip-member", _skip)
