"""The available types of reducers."""

from __future__ import annotations

from torquebench.panel.pages.visitor import Visitor

__all__ = ["reducer_titles"]


def reducer_titles(visitor: Visitor) -> dict[str, str]:
    """Return what each type is called, own ones with the name that they are kept under."""
    titles = {}
    for item in visitor.service.settings.items("reducers"):
        title = visitor.text.core(str(item.document.get("name", item.name)))
        titles[item.name] = title if item.builtin else f"{title} ({item.name})"
    return titles
