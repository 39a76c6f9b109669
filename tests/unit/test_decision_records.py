"""Each decision says whether it holds; one that doesn't names what took its place."""

import re
from pathlib import Path

import pytest

RECORDS = sorted((Path(__file__).parents[2] / "docs" / "decisions").glob("0*.md"))


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.stem)
def test_a_record_has_a_status_and_names_its_successor(record: Path) -> None:
    title, _, status, *_ = record.read_text(encoding="utf-8").splitlines()
    assert title.startswith(f"# {int(record.stem[:4])}. ")
    assert re.match(r"Status: (accepted|superseded|partly superseded)\b", status)
    if "superseded" in status:
        successor = re.search(r"\(((?:\.\./)*[\w/.-]+\.md)\)", status)
        assert successor is not None
        assert (record.parent / successor[1]).is_file()
