import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.records import read_readings_csv, write_torque_csv


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "readings.csv"
        path.write_text(text, encoding="utf-8")
        return read_readings_csv(path)

    return read_text


def test_a_single_column_is_enough(read):
    readings = read("reading_nm\n1.5\n-2\n")
    assert readings.reading_nm.tolist() == [1.5, -2.0]
    known = readings.readings()
    assert known.branch is None
    assert known.speed_rpm is known.temperature_c is known.counter_nm is None


def test_what_the_file_knows_is_handed_to_the_measuring_chain(read):
    header = "reading_nm,branch,series,speed_rpm,temperature_c,standard_error_nm"
    known = read(f"{header}\n1.5,down,2,100,23,0.01\n").readings(zero_temperature_c=22.0)
    assert known.reading_nm.tolist() == [1.5]
    assert known.branch.tolist() == [-1.0]
    assert (known.speed_rpm, known.temperature_c, known.counter_nm) == (100.0, 23.0, 0.01)
    assert (known.zero_temperature_c, known.zero_age_h) == (22.0, None)


def test_a_table_without_readings_is_named(read):
    with pytest.raises(InputError, match="no column reading_nm"):
        read("torque_nm\n1\n")


def test_a_reading_is_named_with_its_line(read):
    assert read("# comment\nreading_nm\n1.5\n-11\n").place(1).endswith("line 4, column reading_nm")


def test_output_keeps_the_input_and_adds_three_columns(read, tmp_path):
    readings = read('# simulated = true\noperator,reading_nm\nAna,1.5\n"B, C",-2\n')
    path = tmp_path / "torque.csv"
    write_torque_csv(path, readings, [1.6, -2.1], [0.1, -0.1], [0.01, 0.02])
    assert path.read_text(encoding="utf-8") == (
        "# simulated = true\n"
        "operator,reading_nm,torque_nm,additional_torque_nm,expanded_uncertainty_nm\n"
        "Ana,1.5,1.6,0.1,0.01\n"
        '"B, C",-2,-2.1,-0.1,0.02\n'
    )
    assert readings.simulated


def test_output_has_the_decimal_mark_of_the_input(read, tmp_path):
    readings = read("reading_nm;note\n1,5;a\n")
    path = tmp_path / "torque.csv"
    write_torque_csv(path, readings, [1.6], [0.1], [0.01])
    assert path.read_text(encoding="utf-8").splitlines()[1] == "1,5;a;1,6;0,1;0,01"
    assert read(path.read_text(encoding="utf-8")).reading_nm.tolist() == [1.5]


def test_a_file_that_is_compensated_already_is_refused(read, tmp_path):
    readings = read("reading_nm,torque_nm\n1.5,1.6\n")
    with pytest.raises(InputError, match="has a column torque_nm already"):
        write_torque_csv(tmp_path / "torque.csv", readings, [1.6], [0.1], [0.01])
    assert not (tmp_path / "torque.csv").exists()


def test_nothing_is_half_written(read, tmp_path):
    readings = read("reading_nm\n1.5\n2.5\n")
    path = tmp_path / "torque.csv"
    path.write_text("old", encoding="utf-8")
    for torque in ([1.6, np.nan], [1.6]):
        with pytest.raises(InputError, match="torque_nm of shape"):
            write_torque_csv(path, readings, torque, [0.1, 0.1], [0.01, 0.01])
    assert path.read_text(encoding="utf-8") == "old"
    with pytest.raises(InputError, match="can't write"):
        write_torque_csv(tmp_path / "no" / "such.csv", readings, [1, 2], [0, 0], [0, 0])
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["readings.csv", "torque.csv"]
