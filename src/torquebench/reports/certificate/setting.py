"""Typeset documents by Typst from a template, its content as JSON, and figures."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.reports.certificate.fonts import fonts_for

if TYPE_CHECKING:
    import typst


def typeset(
    template: Traversable,
    content: Mapping[str, Any],
    files: Mapping[str, str | bytes],
    installed: typst.Fonts | None = None,
    **kind: Any,
) -> list[bytes]:
    """Return a document, or its pages if `kind` requests pictures.

    Parameters
    ----------
    template : Traversable
        Typst template; it reads ``content.json``, to which the names of the fonts are added.
    content : mapping
    files : mapping
        Other files that the template reads, by name.
    installed : typst.Fonts, optional
        Installed fonts; see `fonts_for`.
    **kind
        Options of `typst.Compiler.compile`.

    Raises
    ------
    InputError
        Where no installed font has the text's characters.
    typst.TypstError
        Where Typst fails.
    """
    fonts, families = fonts_for(content, installed)
    text = json.dumps({**content, "fonts": families}, ensure_ascii=False)
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        folder = Path(scratch)
        needed = {"main.typ": template.read_bytes(), "content.json": text, **files}
        for name, each in needed.items():
            (folder / name).write_bytes(each.encode() if isinstance(each, str) else each)
        import typst

        compiler = typst.Compiler(str(folder / "main.typ"), root=str(folder), font_paths=fonts)
        document = compiler.compile(**kind)
    return [document] if isinstance(document, bytes) else document or []
