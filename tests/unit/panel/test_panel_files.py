"""Files of operations: only what was handed in is read, under a name that is no path."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from torquebench.errors import InputError
from torquebench.operations import Result, find_operation
from torquebench.panel.service import NotFoundError
from torquebench.panel.service.files import LARGEST_FILE, MOST_FILES, FileStore


@pytest.fixture
def store() -> Iterator[FileStore]:
    made = FileStore()
    yield made
    made.close()


@pytest.mark.parametrize(
    "name", ["t.csv", "../../etc/passwd", "a/b#c,d.xlsx", "", "..", "x\x1b[2J.csv", "扭矩 7.csv"]
)
def test_a_name_is_no_path(store: FileStore, name: str) -> None:
    reference = store.add(b"content", name)
    path = store.path(reference)
    assert path.read_bytes() == b"content"
    assert path.parent.parent == store.folder
    assert path.resolve().is_relative_to(store.folder.resolve())


@pytest.mark.parametrize(
    "reference",
    ["/etc/passwd", "../x", "0123456789abcdef/../../../etc/passwd", "t.csv", "", "-", "~/x",
     "0123456789abcdef/t.csv"],
)  # fmt: skip
def test_no_other_file_is_read(store: FileStore, reference: str) -> None:
    store.add(b"", "t.csv")
    with pytest.raises(NotFoundError, match="no file"):
        store.path(reference)
    for name, fields in _requests(reference):
        request = find_operation(name).request.model_validate(fields)
        with pytest.raises(NotFoundError, match="no file"):
            store.checked(request, absolute=False)


def _requests(path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    yield "evaluate friction", {"data": [path or "."]}
    yield "verify", {"model": path or ".", "table": path or "."}
    if path:
        yield "budget", {"model": "x", "readings_nm": [1.0], "reference": path}


def test_a_written_file_gets_a_place_of_its_own(store: FileStore) -> None:
    model = store.add(b"{}", "m.json")
    request = find_operation("export").request.model_validate(
        {"model": model, "out": "/etc/table.csv"}
    )
    checked: Any = store.checked(request, absolute=False)
    assert checked.out.name == "table.csv"
    assert (store.folder / checked.out).parent.parent == store.folder
    assert (store.folder / checked.out).parent.is_dir()


def test_what_the_bench_has_written_can_be_downloaded(store: FileStore, tmp_path: Path) -> None:
    """The table of a turning run lay in a folder that only the server could read."""
    table = tmp_path / "run.csv"
    table.write_text("time_s\n1\n", encoding="utf-8")
    result = Result(headline="", files=(str(table), str(tmp_path / "none.csv"), "page.pdf"))
    (reference,) = store.copied(result).files
    assert store.path(reference).read_bytes() == table.read_bytes()
    assert store.path(reference).name == "run.csv"
    assert store.named(result).files == ()


def test_size_and_number_are_limited(store: FileStore) -> None:
    with pytest.raises(InputError, match="an upload of"):
        store.add(b" " * (LARGEST_FILE + 1))
    first = store.add(b"1", "t.csv")
    for _ in range(MOST_FILES):
        last = store.add(b"1", "t.csv")
    assert len(list(Path(store.folder).iterdir())) == MOST_FILES
    store.path(last)
    with pytest.raises(NotFoundError):
        store.path(first)
