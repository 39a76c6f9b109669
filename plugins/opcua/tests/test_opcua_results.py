"""Results are filtered and ordered by the fields of their metadata."""

from datetime import UTC, datetime

import pytest

from torquebench.errors import InputError
from torquebench_opcua import ResultRecord
from torquebench_opcua.results import condition, field_value, ordered

RECORDS = tuple(
    ResultRecord(name, datetime(2026, 11, day, tzinfo=UTC), part, kind, simulated=day > 2)
    for name, day, part, kind in (
        ("c", 3, "T-1", "calibrate-output"),
        ("b", 2, "T-2", "calibrate-output"),
        ("a", 1, "T-1", "certificate"),
    )
)


def value(wanted: object):
    return lambda _result: wanted


def ids(*given, by=(), most=0) -> str:
    wanted = condition(given[0], given[1:]) if given else None
    return "".join(each.result_id for each in ordered(RECORDS, wanted, by, most))


def test_results_are_filtered() -> None:
    part, kind, created = map(field_value, ("PartId", "InternalRecipeId", "CreationTime"))
    second = datetime(2026, 11, 2, tzinfo=UTC)
    assert ids() == "cba"
    assert ids("Equals", part, value("T-1")) == "ca"
    assert ids("Like", kind, value("calibrate%")) == "cb"
    assert ids("GreaterThanOrEqual", created, value(second)) == "cb"
    assert ids("GreaterThanOrEqual", created, value(second.replace(tzinfo=None))) == "cb"
    assert ids("Between", created, value(datetime.min), value(second)) == "ba"
    assert ids("InList", part, value("T-2"), value("T-3")) == "b"
    first = condition("Equals", (part, value("T-1")))
    assert ids("Not", first) == "b"
    assert ids("And", first, condition("Like", (kind, value("cert%")))) == "a"
    assert ids("Or", first, condition("Equals", (part, value("T-2")))) == "cba"
    assert ids("GreaterThan", part, value(3)) == ""
    assert ids("IsNull", part) == ""


def test_results_are_ordered_and_limited() -> None:
    assert ids(by=("ResultId",)) == "abc"
    assert ids(by=("PartId", "ResultId")) == "acb"
    assert ids(by=("ResultId",), most=2) == "ab"


def test_what_no_result_has_is_refused() -> None:
    with pytest.raises(InputError, match="field 'Colour'"):
        field_value("Colour")
    with pytest.raises(InputError, match="filter RelatedTo"):
        condition("RelatedTo", (value(1), value(2)))
    with pytest.raises(InputError, match="Equals with 1"):
        condition("Equals", (value(1),))
