"""Results are filtered and ordered by the fields of their metadata."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from torquebench.errors import InputError
from torquebench_opcua import ResultRecord
from torquebench_opcua.access import VALID_DAYS
from torquebench_opcua.files import IDLE_S
from torquebench_opcua.nodes import VALUES_OF
from torquebench_opcua.results import MOST_RESULTS, condition, field_value, ordered, outcome_of

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


def quantity(verdict: str, limit: str = "≤ 1 arcmin", value: float | None = 0.5) -> dict[str, Any]:
    return {
        "key": "backlash",
        "title": "backlash",
        "value": value,
        "expanded_uncertainty": 0.06,
        "unit": "arcmin",
        "limit": limit,
        "verdict": verdict,
    }


@pytest.mark.parametrize(
    ("quantities", "evaluation", "details"),
    [
        ([quantity("pass"), quantity("", "")], "OK", "pass: backlash 0.5 arcmin (≤ 1 arcmin)"),
        ([quantity("pass"), quantity("fail")], "NotOK", "fail: backlash 0.5 arcmin (≤ 1 arcmin)"),
        ([quantity("conditionalFail")], "NotDecidable", "conditional fail: "),
        ([quantity("", "")], "Undefined", ""),
    ],
)
def test_a_test_is_as_good_as_its_worst_value(
    quantities: list[Any], evaluation: str, details: str
) -> None:
    found = outcome_of({"serial": "R-1", "quantities": quantities, "findings": []})
    assert (found.part_id, found.evaluation) == ("R-1", evaluation)
    assert found.details.startswith(details)
    assert len(found.quantities) == len(quantities)


def test_a_test_with_a_severe_finding_is_not_decidable() -> None:
    finding = {"name": "drive saturation", "message": "the drive was at its limit", "severe": True}
    found = outcome_of({"serial": "R-1", "quantities": [quantity("")], "findings": [finding]})
    assert (found.evaluation, found.details) == ("NotDecidable", finding["message"])


@pytest.mark.parametrize("results", [None, [], {}, {"quantities": None}])
def test_results_without_values_are_undefined(results: Any) -> None:
    assert outcome_of(results).evaluation == "Undefined"


def test_the_page_states_the_figures_of_the_code() -> None:
    page = (Path(__file__).parents[1] / "docs" / "connect-by-opc-ua.md").read_text("utf-8")
    assert f"the newest {MOST_RESULTS} as variables" in page
    assert f"below the newest {VALUES_OF} tests" in page
    assert f"after {IDLE_S:.0f} s without a read it is removed" in page
    assert VALID_DAYS == 5 * 365
