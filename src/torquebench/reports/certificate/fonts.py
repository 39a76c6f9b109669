"""Fonts of a certificate, and the package to install if one is missing."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    import typst

LATIN = "Libertinus Serif"
"""Supplied with Typst, so that a certificate's bytes don't depend on the machine."""

CHINESE = (
    "Noto Serif CJK SC",
    "Source Han Serif SC",
    "Noto Sans CJK SC",
    "Source Han Sans SC",
    "WenQuanYi Zen Hei",
)
"""Chinese fonts; the first installed one is used."""


def has_chinese(texts: Iterable[str]) -> bool:
    """Return whether a text needs a font with Chinese characters.

    Examples
    --------
    >>> has_chinese(["torque", "ΔM"]), has_chinese(["扭矩"])
    (False, True)
    """
    return any(unicodedata.east_asian_width(mark) in "WF" for text in texts for mark in text)


def chinese_family(installed: typst.Fonts) -> str:
    """Return the name of an installed font with Chinese characters.

    Raises
    ------
    InputError
        Where none is installed; the message names the Debian package.
    """
    families = set(installed.families())
    for family in CHINESE:
        if family in families:
            return family
    raise InputError(
        "no font with Chinese characters is installed",
        Message("one of {list}", ", ".join(CHINESE)),
        "on Debian or Ubuntu: apt-get install fonts-noto-cjk",
    )


def fonts_for(content: Any, installed: typst.Fonts | None = None) -> tuple[typst.Fonts, list[str]]:
    """Return the fonts for texts, and the names of their families in order of preference.

    Parameters
    ----------
    content : mapping or sequence
        The texts to set, at any depth.
    installed : typst.Fonts, optional
        Installed fonts; by default those of the system.

    Raises
    ------
    InputError
        Where a text is Chinese and no font for it is installed.
    """
    if not has_chinese(_texts(content)):
        return _fonts(), [LATIN]
    found = installed or _system_fonts()
    family = chinese_family(found)
    folders = sorted(
        {
            str(Path(font.path).parent)
            for font in found.fonts()
            if font.family == family and font.path
        }
    )
    return _fonts(*folders), [LATIN, family]


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list | tuple):
        for value in content.values() if isinstance(content, dict) else content:
            yield from _texts(value)


@cache
def _system_fonts() -> typst.Fonts:
    import typst  # late: 7 MB that only certificates need

    return typst.Fonts()


@cache
def _fonts(*folders: str) -> typst.Fonts:
    import typst

    return typst.Fonts(include_system_fonts=False, font_paths=list(folders))
