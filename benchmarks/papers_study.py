"""When the papers' network beats a quadratic by 2.2: the wide table of the documentation.

``python -m benchmarks.papers_study --write`` writes docs/explanation/when-the-network-wins.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from torquebench.papers.study import (
    CLAIMED_RATIO,
    MOST_EPOCHS,
    NETWORK_NM,
    POLYNOMIAL_NM,
    Contender,
    Row,
    Series,
    contenders,
    run_study,
)

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "when-the-network-wins.md"
FAMILY_WORDS = {
    "smooth": "a quadratic of its own in each direction",
    "reversing": "the same with a step at reversal and a loop between the branches",
    "rippled": "the same with ripple and two local errors",
}


def parts() -> list[tuple[str, Series, tuple[Contender, ...]]]:
    """Return what is studied, the quick parts first: families, series and models."""
    whole = contenders((1_000, 10_000, 50_000))
    return [
        *[(family, "50 rising", whole) for family in FAMILY_WORDS],
        ("reversing", "50 up and down", whole),
        *[(family, "200 up and down", whole) for family in FAMILY_WORDS],
    ]


def table(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table: a line a model, a column a family and series."""
    columns = list(dict.fromkeys((row.family, row.series) for row in rows))
    cells = {
        (row.title, row.family, row.series): f"{row.worst_nm:.2f} ({row.beats})" for row in rows
    }
    lines = [
        "| model | " + " | ".join(f"{family}, {series}" for family, series in columns) + " |",
        "| --- |" + " ---: |" * len(columns),
    ]
    for title in dict.fromkeys(row.title for row in rows):
        values = (cells.get((title, *column), "-") for column in columns)
        lines.append(f"| {title} | " + " | ".join(values) + " |")
    return "\n".join(lines)


def page(found: Sequence[tuple[str, list[Row]]], seeds: int) -> str:
    """Return the page of the documentation."""
    families = "; ".join(f"*{family}*: {words}" for family, words in FAMILY_WORDS.items())
    return (
        "# When the network beats the polynomial\n\n"
        f"The papers report errors below {NETWORK_NM:g} N·m after a back-propagation (BP) network "
        f"and up to {POLYNOMIAL_NM:g} N·m after a polynomial, on 2000 N·m: a ratio of "
        f"{CLAIMED_RATIO:.1f}. They publish neither start weights nor learning rate nor epochs, "
        "and the result depends on them: [what follows from the table]"
        "(source-papers.md#when-the-network-beats-the-polynomial).\n\n"
        f"Simulated: {seeds} synthetic chains of each family are scaled so that the best "
        f"quadratic has an error of exactly {POLYNOMIAL_NM:g} N·m; single readings repeat within "
        f"0.2 N·m (standard deviation). {families}. Repeat it by `python -m "
        f"benchmarks.papers_study --seeds {seeds} --write`.\n\n"
        "A cell states the median over the chains of the worst of 500 fresh single readings, "
        "which load as the calibration did, in N·m; in brackets, the number of chains on which "
        f"the quadratic's worst error is at least {CLAIMED_RATIO:.1f} times as large. BP is the "
        "papers' 1-50-1 network with plain batch gradient descent, learning rate 0.01; small "
        "start weights lie evenly within ±0.5. *Until*: trained until the RMS of the residuals "
        f"is below this error, at most {MOST_EPOCHS} epochs.\n\n"
        f"{table([row for _, rows in found for row in rows])}\n"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print or write its page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    found = []
    for family, series, models in parts():
        started = time.perf_counter()
        found.append(
            (family, run_study(range(chosen.seeds), (family,), (series,), models, workers=2))
        )
        print(f"{family}, {series}: {time.perf_counter() - started:.0f} s", flush=True)
        if chosen.write:
            PAGE.write_text(page(found, chosen.seeds), encoding="utf-8")
    if not chosen.write:
        print(page(found, chosen.seeds))


if __name__ == "__main__":
    main()
