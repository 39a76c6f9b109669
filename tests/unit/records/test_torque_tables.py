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
    assert readings.features(3).tolist() == [[1.5, 0, 0], [-2.0, 0, 0]]


def test_branch_series_speed_and_temperature_are_handed_to_the_model(read):
    readings = read("reading_nm,branch,series,speed_rpm,temperature_c\n1.5,down,2,100,23\n")
    assert readings.features(5).tolist() == [[1.5, -1, 2, 100, 23]]
    assert readings.features(1).tolist() == [[1.5]]


def test_a_temperature_that_the_model_needs_is_not_guessed(read):
    with pytest.raises(InputError, match="no column speed_rpm"):
        read("reading_nm,temperature_c\n1.5,23\n").features(5)


def test_a_table_without_readings_is_named(read):
    with pytest.raises(InputError, match="no column reading_nm"):
        read("torque_nm\n1\n")


def test_a_reading_outside_the_models_range_is_named_with_its_line(read):
    readings = read("# comment\nreading_nm\n1.5\n-11\n")
    readings.check_range(-11.0, 11.0)
    with pytest.raises(InputError, match=r"line 4, column reading_nm: -11 N·m .*-10 to 10 N·m"):
        readings.check_range(-10.0, 10.0)


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
