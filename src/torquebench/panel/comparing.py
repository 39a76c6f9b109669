"""The comparison of models, run in a process of its own that imports little."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from torquebench.compensation import Comparison, compare
from torquebench.progress import Progress

__all__ = ["compare_points"]


def compare_points(X: Any, y: Any, range_nm: float, progress: Progress) -> Comparison:
    """Compare all candidates on some points; return the table without the fitted models."""
    return replace(compare(X, y, range_nm=range_nm, progress=progress), models={})
