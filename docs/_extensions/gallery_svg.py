"""Figures of the gallery as SVG."""

from typing import Any

from sphinx_gallery.scrapers import matplotlib_scraper


def svg_figures(*given: Any, **settings: Any) -> str:
    """Keep the figures that a block of an example has drawn."""
    return str(matplotlib_scraper(*given, format="svg", **settings))
