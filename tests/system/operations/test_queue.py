"""A queue of operations in a file: done in order until one fails, and checked as a whole before."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from torquebench.errors import InputError
from torquebench.operations import PackagedLibrary, Place, find_operation
from torquebench.progress import NO_PROGRESS
from torquebench.station import Station

RUN = find_operation("run")
ZERO = '[[operation]]\nname = "zero"\nrequest = {sides = ["input"]}\n'
CHECK = '[[operation]]\nname = "check"\nrequest = {side = "input", tolerance_percent_fs = 1e-6}\n'
MISSING = '[[operation]]\nname = "records use"\nrequest = {model = 99}\n'
UNKNOWN = '[[operation]]\nname = "verification"\nrequest = {side = "input", models = [99]}\n'


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with Station.open(None, tmp_path_factory.mktemp("queue")) as station:
        yield Place("Ana", PackagedLibrary(), station.registry, station)


def queue(folder: Path, *parts: str) -> Path:
    file = folder / "queue.toml"
    file.write_text("\n".join(parts), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("parts", "keep_going", "failed"),
    [
        ((ZERO, ZERO), False, [False, False]),
        ((CHECK, ZERO), False, [True, True]),
        ((CHECK, ZERO), True, [True, False]),
        ((MISSING, ZERO), True, [True, True]),
    ],
)
def test_it_ends_at_an_error_and_at_a_failed_check(
    place: Place, tmp_path: Path, parts: tuple[str, ...], keep_going: bool, failed: list[bool]
) -> None:
    request = RUN.request(queue=queue(tmp_path, *parts), keep_going=keep_going)
    result = RUN.run(place, request, NO_PROGRESS)
    assert [each["failed"] for each in result.plain()["operations"]] == failed
    assert result.failed == any(failed)
    assert len(result.page().sections[0].blocks[0].rows) == 2
    assert all(place.registry.run(run_id).status == "completed" for run_id in result.run_ids)


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ('[[operation]]\nname = "nothing"', "operation 2: no operation 'nothing'"),
        ('[[operation]]\nname = "check"', "operation 2: check: side"),
        ('[[operation]]\nname = "run"\nrequest = {queue = "q.toml"}', "run in a queue"),
        ("operations = 1", "operations"),
    ],
)
def test_a_wrong_file_is_refused_before_the_first(
    place: Place, tmp_path: Path, part: str, words: str
) -> None:
    request = RUN.request(queue=queue(tmp_path, *((ZERO, part) if "[[" in part else (part, ZERO))))
    runs = len(place.registry.runs())
    with pytest.raises(InputError, match=words):
        RUN.doubts(place, request)
    with pytest.raises(InputError, match=words):
        RUN.run(place, request, NO_PROGRESS)
    assert len(place.registry.runs()) == runs


def test_a_preview_contains_every_operation(place: Place, tmp_path: Path) -> None:
    assert RUN.preview is not None
    shown = RUN.preview(place, RUN.request(queue=queue(tmp_path, ZERO, CHECK, UNKNOWN)))
    assert shown.points > 0
    assert any("99" in each for each in shown.remarks)
