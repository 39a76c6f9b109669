"""Where a benchmark's report stands in a document: between two markers of its own."""

from __future__ import annotations

from pathlib import Path

__all__ = ["BENCHMARKS", "write_section"]

BENCHMARKS = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"


def write_section(document: Path, name: str, text: str) -> None:
    """Replace what stands between a section's markers; begin document or section if need be.

    Parameters
    ----------
    document : pathlib.Path
    name : str
        Of the section, as in ``<!-- name: begin -->``.
    text : str
        Markdown.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before = document.read_text(encoding="utf-8") if document.exists() else "# Benchmarks\n"
    if begin not in before:
        before = before.rstrip() + f"\n\n{begin}\n{end}\n"
    head, rest = before.split(begin, 1)
    tail = rest.split(end, 1)[1]
    document.parent.mkdir(exist_ok=True)
    document.write_text(f"{head}{begin}\n{text.strip()}\n{end}{tail}", encoding="utf-8")
