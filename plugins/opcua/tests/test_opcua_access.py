import os
import stat
from pathlib import Path

import pytest

from torquebench.errors import RecordError
from torquebench_opcua.access import Store


def test_a_key_is_written_whole_and_its_owners_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    store = Store(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(RecordError, match="No space left"):
            store.prepare("localhost")
    assert sorted(path.name for path in store.folder.iterdir()) == ["rejected", "trusted"]
    store.prepare("localhost")
    assert stat.S_IMODE(store.key.stat().st_mode) == 0o600
    certificate = store.certificate.read_bytes()
    store.reject(certificate)
    (rejected,) = store.rejected.iterdir()
    assert rejected.read_bytes() == certificate
    assert stat.S_IMODE(rejected.stat().st_mode) == 0o600
