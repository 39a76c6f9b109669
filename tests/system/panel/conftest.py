"""What tests of the panel share."""

from tests.unit.panel.conftest import quick_passwords

__all__ = ["quick_passwords"]
