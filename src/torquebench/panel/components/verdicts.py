"""Appearance of verdicts on all pages."""

from __future__ import annotations

from torquebench.uncertainty import Verdict

_LOOKS = {
    Verdict.NONE: ("", "check_circle"),
    Verdict.PASS: ("good", "check_circle"),
    Verdict.CONDITIONAL_PASS: ("warn", "warning"),
    Verdict.CONDITIONAL_FAIL: ("warn", "warning"),
    Verdict.FAIL: ("bad", "error"),
}


def verdict_kind(verdict: str) -> str:
    """Return the kind of tag or note for a verdict.

    Examples
    --------
    >>> verdict_kind("pass"), verdict_kind("conditionalFail"), verdict_kind("")
    ('good', 'warn', '')
    """
    return _LOOKS[Verdict(verdict)][0]


def verdict_icon(verdict: str) -> str:
    """Return the icon of a verdict."""
    return _LOOKS[Verdict(verdict)][1]
