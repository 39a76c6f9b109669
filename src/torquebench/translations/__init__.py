"""Translations of what the core says, for panel and certificates; the English text is the key.

`zh/` and `de/` hold the texts by language, `en/` the words for short names.
"""

from torquebench.translations.catalogue import has_words, templates, translated

__all__ = ["has_words", "templates", "translated"]
