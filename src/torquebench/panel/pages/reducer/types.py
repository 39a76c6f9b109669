"""The available types of reducers."""

from __future__ import annotations

from torquebench.panel.pages.visitor import Visitor

__all__ = ["reducer_titles"]


def reducer_titles(visitor: Visitor) -> dict[str, str]:
    """Return the title of each type; a user's types with the name under which they are stored."""
    titles = {}
    for item in visitor.service.settings.items("reducers"):
        title = visitor.text.core(str(item.document.get("name", item.name)))
        titles[item.name] = title if item.builtin else f"{title} ({item.name})"
    return titles
