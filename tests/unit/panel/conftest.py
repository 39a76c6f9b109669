"""What tests of the panel share."""

import pytest
from argon2 import PasswordHasher

from torquebench.panel.service.access import passwords


@pytest.fixture(autouse=True)
def quick_passwords(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hash passwords at once: at full strength each takes a quarter of a second."""
    quick = PasswordHasher(time_cost=1, memory_cost=1024, parallelism=1)
    monkeypatch.setattr(passwords, "_hasher", quick)
