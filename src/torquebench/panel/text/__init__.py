"""The panel's texts in English and Chinese, with the same keys and placeholders."""

from torquebench.panel.text.catalogue import LANGUAGES, Language, Text, choose_language, words

__all__ = ["LANGUAGES", "Language", "Text", "choose_language", "words"]
