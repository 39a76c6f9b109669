import pytest

from torquebench.errors import InputError
from torquebench.tables import read_readings


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "readings.csv"
        path.write_text(text, encoding="utf-8")
        return read_readings(path)

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
