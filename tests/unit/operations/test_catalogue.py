"""The catalogue of operations."""

from torquebench.operations import OPERATIONS
from torquebench.operations.catalogue import summary_of


def test_summaries_for_the_list_of_commands_are_those_of_the_requests() -> None:
    for name, operation in OPERATIONS.items():
        assert summary_of(name) == operation.summary
