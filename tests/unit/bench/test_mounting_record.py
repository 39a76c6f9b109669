import pytest
from pydantic import ValidationError

from torquebench.bench.mounting_record import MountingRecord


def test_true_and_false_are_no_figures() -> None:
    assert MountingRecord(lubricant_hours=0.0).lubricant_hours == 0.0
    with pytest.raises(ValidationError, match="not true or false"):
        MountingRecord(lubricant_hours=False)
