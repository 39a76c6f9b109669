"""Run folders in a store that speaks S3, on moto's server, and on a share."""

import resource
from pathlib import Path

import pytest
from plugins.plant.tests.plant_bench import filled

from torquebench.errors import InputError, RecordError
from torquebench.records import MANIFEST, Registry, sha256_of_file
from torquebench_plant import FolderStore


@pytest.mark.parametrize("kind", ["share", "bucket"])
def test_a_folder_arrives_whole_and_is_verified(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    url = f"file://{tmp_path}/share" if kind == "share" else request.getfixturevalue("bucket")
    data = filled(tmp_path / "data", 1)
    with Registry.open(data) as registry:
        folders = [run.folder for run in registry.runs()]
    store = FolderStore(url)
    for folder in folders:
        manifest = sha256_of_file(folder / MANIFEST)
        pushed = store.push(folder, manifest, f"{store.url}/{folder.name}")
        assert pushed.size == sum(path.stat().st_size for path in folder.iterdir())
        assert store.verify(pushed.url, manifest) == []
        for path in folder.iterdir():
            assert store.read(f"{pushed.url}/{path.name}") == path.read_bytes()
        store.put(f"{pushed.url}/results.json", b"{}")
        assert "results.json was changed" in store.verify(pushed.url, manifest)[0]
        assert "can't be read" in store.verify(f"{store.url}/none", manifest)[0]


def test_a_full_share_is_named_and_keeps_no_partial_file(tmp_path: Path) -> None:
    """A limit on this process's file size simulates a full share."""
    store = FolderStore(f"file://{tmp_path}/share")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(RecordError, match="can't be written"):
            store.put(f"{store.url}/runs/x.parquet", bytes(100_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list((tmp_path / "share" / "runs").iterdir()) == []
    store.put(f"{store.url}/runs/x.parquet", bytes(100_000))
    assert [path.name for path in (tmp_path / "share" / "runs").iterdir()] == ["x.parquet"]


def test_a_store_that_is_away_is_named(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
    with pytest.raises(RecordError, match=r"s3://plant/runs/x can't be written"):
        FolderStore(bucket).put(f"{bucket}/x", b"1")
    with pytest.raises(InputError, match="nosuch"):
        FolderStore("nosuch://x")
