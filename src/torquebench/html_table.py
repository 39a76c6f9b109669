"""Small tables in HTML, for notebooks."""

from collections.abc import Iterable, Sequence
from html import escape


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML.

    Examples
    --------
    >>> html_table("U < 1", ("torque",), [("5 N·m",)])
    '<table><caption>U &lt; 1</caption><tr><th>torque</th></tr><tr><td>5 N·m</td></tr></table>'
    """
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    first = f"<tr>{head}</tr>" if header else ""
    return f"<table><caption>{escape(caption)}</caption>{first}{body}</table>"
