"""The catalogue of operations."""

from torquebench.operations import OPERATIONS
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
