"""Labels of settings, and the units of their keys."""

from __future__ import annotations

from torquebench.panel.pages.settings.labels import CHOICES, GROUPS, LABELS
from torquebench.panel.text import Text


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
    return text(LABELS.get(f"{parent}_{last}") or LABELS.get(last, last))


def group_title(text: Text, group: str) -> str:
    """Return the title of a group of settings.

    Examples
    --------
    >>> group_title(Text("en"), "output.limits"), group_title(Text("en"), "")
    ('Output module: Limits', 'General')
    """
    if not group:
        return text("General")
    return ": ".join(text.title(GROUPS.get(part, part)) for part in group.split("."))


def choice_title(text: Text, choice: str) -> str:
    """Return what a choice means; one without a label is a name."""
    return text(CHOICES.get(choice, choice))
