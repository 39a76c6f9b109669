"""The OpenAPI description: every operation and every number says what it is, examples hold."""

import contextlib
import re
from types import SimpleNamespace
from typing import Any, cast

import jsonschema  # type: ignore[import-untyped]
import pytest

from torquebench.bench.description import default_bench
from torquebench.columns import column_of
from torquebench.operations import OPERATIONS
from torquebench.panel.api import create_api, reference_page
from torquebench.panel.api.describing import EXAMPLES, ROLES
from torquebench.panel.service import BenchService
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.panel.service.store import PanelStore


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    with contextlib.closing(PanelStore(tmp_path_factory.mktemp("panel"))) as store:
        service = SimpleNamespace(settings=SettingsStore(store, default_bench()))
        return create_api(cast(BenchService, service)).openapi()


def operations(described: dict[str, Any]) -> dict[str, dict[str, Any]]:
    found = [each for path in described["paths"].values() for each in path.values()]
    return {each["operationId"]: each for each in found}


def test_every_operation_says_what_it_does_who_may_and_what_it_refuses(
    described: dict[str, Any],
) -> None:
    found = operations(described)
    assert set(ROLES) <= set(found)
    for name, operation in found.items():
        assert operation["description"].strip(), name
        assert "422" in operation["responses"], name
        if name not in ("set_up", "sign_in"):
            assert operation["x-role"] in operation["description"], name
            assert operation["security"] == [{"bearer": []}], name
        assert ("413" in operation["responses"]) == ("requestBody" in operation), name


def test_every_quantity_has_its_unit(described: dict[str, Any]) -> None:
    schemas = described["components"]["schemas"]
    numbers = {
        name: value
        for schema in schemas.values()
        for name, value in schema.get("properties", {}).items()
        if re.search(r"_(nm|rpm|percent|deg|s)$", name)
    }
    assert {"error_nm", "limit_rpm", "bench_time_s", "step_percent"} <= set(numbers)
    assert [name for name, value in numbers.items() if not value.get("x-unit")] == []
    assert numbers["error_nm"]["x-unit"] == "N·m"


def test_a_column_is_described_as_in_files(described: dict[str, Any]) -> None:
    points = described["components"]["schemas"]["CalibrationPoints"]["properties"]
    for name in ("reading_nm", "branch"):
        assert points[name]["description"] == column_of(name).sentence


def test_no_docstring_leaks_its_markup(described: dict[str, Any]) -> None:
    for name, schema in described["components"]["schemas"].items():
        assert "-----" not in schema.get("description", ""), name


def test_models_profiles_and_reducers_are_enumerated(described: dict[str, Any]) -> None:
    schemas = described["components"]["schemas"]
    calibrate = schemas["CalibrateRequest"]["properties"]
    assert {"hybrid", "polynomial-2", "published-network"} <= set(
        calibrate["models"]["items"]["enum"]
    )
    assert "hybrid" in schemas["FitModelRequest"]["properties"]["model"]["enum"]
    assert "rapid-in-situ" in calibrate["profile"]["enum"]
    assert "verification" not in calibrate["profile"]["enum"]
    assert schemas["VerificationRequest"]["properties"]["profile"]["enum"] == ["verification"]
    assert "standard" in schemas["ReducerTestRequest"]["properties"]["reducer"]["anyOf"][0]["enum"]


def test_the_result_of_every_operation_is_typed(described: dict[str, Any]) -> None:
    schemas = described["components"]["schemas"]
    results = schemas["JobView"]["properties"]["result"]["anyOf"]
    named = {each["$ref"].rpartition("/")[2] for each in results if "$ref" in each}
    assert named == {each.result.__name__ for each in OPERATIONS.values() if each.served}
    for name in named:
        schema = schemas[name]
        assert schema["description"], name
        assert all(value for value in schema["properties"].values()), name


def test_no_record_states_a_path_of_the_server(described: dict[str, Any]) -> None:
    schemas = described["components"]["schemas"]
    assert "folder" not in schemas["RunSummary"]["properties"]
    assert "file" not in schemas["ModelEntry"]["properties"]
    assert "profile" in schemas["CalibrationEntry"]["properties"]


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_may_be_sent(described: dict[str, Any], name: str) -> None:
    schemas = described["components"]["schemas"]
    assert schemas[name]["examples"] == [EXAMPLES[name]]
    whole = {"components": {"schemas": schemas}, "$ref": f"#/components/schemas/{name}"}
    jsonschema.Draft202012Validator(whole).validate(EXAMPLES[name])


def test_the_reference_page_folds_every_operation_with_its_fields_and_needs_no_network(
    described: dict[str, Any],
) -> None:
    page = reference_page(described)
    assert not re.search(r"(src|href)=", page)
    folded = dict(
        re.findall(r"<details><summary>(.*?)</summary>(.*?)</details>", page, flags=re.DOTALL)
    )
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            shown = folded[f"{method.upper()} /api/v1{path}"]
            for parameter in operation.get("parameters", ()):
                assert parameter["name"] in shown
    calibrate = folded["POST /api/v1/operations/calibrate"]
    assert re.search(r"step_percent.*?0\.1.*?100.*?%.*?Width of the steps", calibrate, re.DOTALL)
    assert {"JobView", "CalibrateRequest"} <= set(folded)
