"""Labels of settings, and the units of their keys."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources

from torquebench.panel.text import Text, Texts

__all__ = ["choice_title", "group_title", "setting_title"]


@cache
def labels() -> dict[str, Texts]:
    """Return the English labels of settings, their groups and choices, by the keys of the files."""
    file = resources.files("torquebench.panel.pages.settings") / "labels.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def setting_title(text: Text, key: str) -> str:
    """Return the label of a setting; without one, the last word of its key.

    Examples
    --------
    >>> setting_title(Text("en"), "output.limits.torque_nm")
    'Maximum torque'
    >>> setting_title(Text("en"), "input.drive.torque_rate_nm_per_s")
    'Torque ramp'
    """
    group, _, last = key.rpartition(".")
    parent = group.rpartition(".")[2]
    known = labels()["setting"]
    return text(known.get(f"{parent}_{last}") or known.get(last, last))


def group_title(text: Text, group: str) -> str:
    """Return the title of a group of settings.

    Examples
    --------
    >>> group_title(Text("en"), "output.limits"), group_title(Text("en"), "")
    ('Output module: Limits', 'General')
    """
    if not group:
        return text("General")
    known = labels()["setting_group"]
    return ": ".join(text.title(known.get(part, part)) for part in group.split("."))


def choice_title(text: Text, choice: str) -> str:
    """Return what a choice means; one without a label is a name."""
    return text(labels()["setting_choice"].get(choice, choice))
