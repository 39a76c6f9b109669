"""What people type into the fields of an operation's form."""

from torquebench.operations import OPERATIONS, parameters
from torquebench.panel.pages.operations.form import field_text, field_value
from torquebench.validation import faults_of


def test_numbers_are_typed_with_commas_between_them() -> None:
    """Readings of a budget and pairs of limits could be typed in no way."""
    typed = set()
    for operation in filter(lambda each: each.served, OPERATIONS.values()):
        for field in parameters(operation.request):
            if field.kind in ("number", "whole") and (field.several or field.pair):
                values = {field.name: field_value(field, "1, 2.5" if field.pair else "1, 2")}
                assert field.name not in faults_of(operation.request, values, "")
                typed.add(field.name)
    assert {"readings_nm", "interval_percent"} <= typed


def test_a_default_is_read_as_it_is_shown() -> None:
    for operation in filter(lambda each: each.served, OPERATIONS.values()):
        for field in parameters(operation.request):
            if field.kind in ("number", "whole", "text") and field.default not in (None, "", ()):
                value = field_value(field, field_text(field, field.default))
                assert field.name not in faults_of(operation.request, {field.name: value}, "")
