import json
from dataclasses import replace
from datetime import UTC, date, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.records.chain import (
    START,
    ChainHead,
    broken_links,
    canonical,
    changed_fields,
    seal,
)

MOMENT = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=4,
)
CONTENTS = st.dictionaries(st.text(min_size=1, max_size=6), VALUES, min_size=1, max_size=5)


def chain(contents):
    head, links = ChainHead(0, START), []
    for key, content in enumerate(contents, start=1):
        links.append(seal(head, "runs", key, MOMENT, canonical(content)))
        head = ChainHead(links[-1].sequence, links[-1].sha256)
    return links


@given(st.lists(CONTENTS, min_size=1, max_size=5))
def test_an_untouched_chain_is_whole(contents):
    assert list(broken_links(chain(contents))) == []


@given(st.lists(CONTENTS, min_size=1, max_size=4), st.data())
def test_any_single_changed_field_of_any_record_breaks_the_chain(contents, draw):
    links = chain(contents)
    place = draw.draw(st.integers(0, len(links) - 1))
    content = contents[place]
    name = draw.draw(st.sampled_from(sorted(content)))
    value = draw.draw(VALUES)
    changed = canonical({**content, name: value})
    if changed == links[place].content:
        return
    links[place] = replace(links[place], content=changed)
    (found,) = broken_links(links)
    assert found[0].sequence == place + 1
    before, now = json.loads(canonical(content)), json.loads(changed)
    ((field, was, is_now),) = changed_fields(before, now)
    assert field == name
    assert (canonical({"": was}), canonical({"": is_now})) == (
        canonical({"": before[name]}),
        canonical({"": now[name]}),
    )


@given(
    st.sampled_from(["sequence", "table", "key", "recorded", "previous_sha256", "sha256"]),
    st.integers(0, 2),
)
def test_every_other_part_of_a_link_is_covered(part, place):
    links = chain([{"kind": "zero"}, {"kind": "verify"}, {"kind": "zero"}])
    value = getattr(links[place], part)
    links[place] = replace(
        links[place], **{part: value + 1 if isinstance(value, int) else "f" + value[1:] + "0"}
    )
    assert list(broken_links(links))


@given(st.integers(0, 3), st.integers(0, 3))
def test_records_that_swap_places_or_go_missing_break_the_chain(first, second):
    links = chain([{"n": n} for n in range(5)])
    swapped = links.copy()
    swapped[first], swapped[second] = swapped[second], swapped[first]
    assert bool(list(broken_links(swapped))) == (first != second)
    assert list(broken_links(links[:first] + links[first + 1 :]))


def test_a_record_is_written_in_one_way_only():
    one = canonical({"b": 0.1, "a": MOMENT, "due": date(2026, 1, 31)})
    assert one == canonical({"a": MOMENT, "due": date(2026, 1, 31), "b": 0.1})
    assert one == '{"a":"2025-01-31T12:00:00.000000+00:00","b":0.1,"due":"2026-01-31"}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical({"range_nm": float("nan")})
    with pytest.raises(TypeError, match="a set in a record"):
        canonical({"range_nm": {1.0}})


def test_fields_of_a_later_schema_are_no_change():
    assert changed_fields({"kind": "zero"}, {"kind": "zero", "shift": "night"}) == []
    assert changed_fields({"kind": "zero"}, {}) == [("kind", "zero", None)]
