"""The comparison of models, run in a process of its own that imports little."""

from __future__ import annotations

import json
from typing import Any

from torquebench.campaign.fitting import model_title
from torquebench.compensation import Comparison, compare
from torquebench.message import Message
from torquebench.progress import Progress
from torquebench.records import json_text

__all__ = ["compare_points"]


def compare_points(X: Any, y: Any, range_nm: float, progress: Progress) -> dict[str, Any]:
    """Compare all candidates on some points; return the table as JSON."""
    found: Comparison = compare(X, y, range_nm=range_nm, progress=progress)
    scores = [
        json.loads(json_text(score)) | {"title": model_title(score.name)} for score in found.scores
    ]
    return {
        "scores": scores,
        "best": found.best,
        "sentence": Message("Least error at points left out: {model}.", model_title(found.best)),
        "refused": dict(found.refused),
        "noise": None if found.noise is None else json.loads(json_text(found.noise)),
        "steps": found.steps,
        "folds": found.folds,
    }
