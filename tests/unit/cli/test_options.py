"""Options that several commands share."""

from pathlib import Path

import pytest

from torquebench.cli.options import check_output, named_values
from torquebench.errors import InputError
from torquebench.operations.place import data_directory


def test_an_output_in_an_existing_folder_is_fine(tmp_path: Path) -> None:
    target = tmp_path / "out.csv"
    assert check_output(target, tmp_path / "in.csv") == target
    assert not target.exists()


def test_outputs_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text("reading_nm\n1\n")
    for bad in (tmp_path, tmp_path / "missing" / "out.csv", tmp_path / "." / "in.csv"):
        with pytest.raises(InputError):
            check_output(bad, source)


def test_a_link_into_a_missing_folder_names_that_folder(tmp_path: Path) -> None:
    link = tmp_path / "link.csv"
    link.symlink_to("missing/out.csv")
    with pytest.raises(InputError, match=f"there is no folder {tmp_path / 'missing'}"):
        check_output(link)


def test_a_folder_without_records_is_refused_and_not_created(tmp_path: Path) -> None:
    missing = tmp_path / "nothing"
    with pytest.raises(InputError, match="no records"):
        data_directory(missing)
    assert not missing.exists()


def test_a_name_given_twice_is_refused() -> None:
    assert named_values(["serial = 4", "by=Ann"], "change", "by=Ann") == {
        "serial": "4",
        "by": "Ann",
    }
    with pytest.raises(InputError, match="change by twice"):
        named_values(["by=Ann", "by=Bob"], "change", "by=Ann")
