"""Links of the pages beside the source lead somewhere; `make docs` follows those of the site."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(ROOT.glob("*.md"))
LINK = re.compile(r"\]\(([^)\s]+)\)")


def anchors(page: Path) -> set[str]:
    """Return the headings of a page as the web shows them in addresses."""
    titles = [line.lstrip("#").strip() for line in page.read_text().splitlines() if line[:1] == "#"]
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title) for title in titles]
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    lost = []
    for link in LINK.findall(page.read_text()):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, heading = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        missing = not target.exists()
        headed = bool(heading) and target.suffix == ".md"
        if missing or (headed and heading not in anchors(target)):
            lost.append(link)
    assert not lost
