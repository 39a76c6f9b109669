"""The panel's texts: short names of English texts; `translations/zh/` has the Chinese by these."""

from torquebench.panel.text.catalogue import LANGUAGES, Language, Text, choose_language, words

__all__ = ["LANGUAGES", "Language", "Text", "choose_language", "words"]
