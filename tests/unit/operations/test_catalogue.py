"""The catalogue of operations."""

from torquebench.operations import OPERATIONS, parameters
from torquebench.operations.catalogue import summary_of
from torquebench.validation import faults_of


def test_summaries_for_the_list_of_commands_are_those_of_the_requests() -> None:
    for name, operation in OPERATIONS.items():
        assert summary_of(name) == operation.summary


def test_a_text_of_the_wrong_form_is_refused_in_words() -> None:
    """A certificate's number was refused with pydantic's regular expression."""
    refused = 0
    for operation in OPERATIONS.values():
        properties = operation.request.model_json_schema()["properties"]
        for name in (name for name, values in properties.items() if "pattern" in values):
            fault = faults_of(operation.request, {name: "?!"}, "request")[name]
            assert "pattern" not in fault.allowed
            assert fault.allowed
            refused += 1
    assert refused >= 3


def test_a_value_of_another_type_is_refused_in_words() -> None:
    """Forms showed pydantic's "Input should be a valid number" as what is allowed."""
    for operation in OPERATIONS.values():
        for parameter in parameters(operation.request):
            fault = faults_of(operation.request, {parameter.name: object()}, "").get(parameter.name)
            if fault is not None:
                assert "should" not in fault.allowed, (operation.name, parameter.name)
