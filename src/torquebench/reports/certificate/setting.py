"""Texts set by Typst: a template, its content as JSON, and the files that it shows."""

import json
import tempfile
from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import typst

from torquebench.reports.certificate.fonts import fonts_for

__all__ = ["typeset"]


def typeset(
    template: Traversable,
    content: Mapping[str, Any],
    files: Mapping[str, str | bytes],
    installed: typst.Fonts | None = None,
    **kind: Any,
) -> list[bytes]:
    """Return a document, or its pages where `kind` asks for pictures.

    Parameters
    ----------
    template : Traversable
        Reads ``content.json``, which has the names of the fonts too.
    content : mapping
    files : mapping
        Files beside it, by their names.
    installed : typst.Fonts, optional
        As for `fonts_for`.
    **kind
        As `typst.Compiler.compile` takes them.

    Raises
    ------
    InputError
        Where there is no font for the text.
    typst.TypstError
        Where it can't be set.
    """
    fonts, families = fonts_for(content, installed)
    text = json.dumps({**content, "fonts": families}, ensure_ascii=False)
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        folder = Path(scratch)
        needed = {"main.typ": template.read_bytes(), "content.json": text, **files}
        for name, each in needed.items():
            (folder / name).write_bytes(each.encode() if isinstance(each, str) else each)
        compiler = typst.Compiler(str(folder / "main.typ"), root=str(folder), font_paths=fonts)
        document = compiler.compile(**kind)
    return [document] if isinstance(document, bytes) else document or []
