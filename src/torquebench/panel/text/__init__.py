"""The panel's words, in English and Chinese; the same keys and placeholders in both."""

from torquebench.panel.text.catalogue import LANGUAGES, Language, Text, choose_language, words

__all__ = ["LANGUAGES", "Language", "Text", "choose_language", "words"]
