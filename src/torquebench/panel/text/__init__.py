"""The panel's texts, by their English; `translations/zh/` has the Chinese."""

from torquebench.panel.text.catalogue import LANGUAGES, Language, Text, choose_language
from torquebench.panel.text.words import ALARM_TITLES, JOB_STATES, Texts

__all__ = [
    "ALARM_TITLES",
    "JOB_STATES",
    "LANGUAGES",
    "Language",
    "Text",
    "Texts",
    "choose_language",
]
