import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from torquebench.calibration import CalibrationData
from torquebench.errors import InputError
from torquebench.tables import read_calibration, read_readings, write_calibration

GOOD = """\
reading_nm,standard_nm,series
0.1,0.0,1
5.2,5.0,1
10.1,10.0,1
5.4,5.0,1
0.2,0.0,1
"""


@pytest.fixture
def read(tmp_path):
    def read_text(text, **options):
        path = tmp_path / "data.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_calibration(path, **options)

    return read_text


def test_a_plain_table_is_read_and_its_branches_follow_from_the_order(read):
    data = read(GOOD, range_nm=10.0)
    assert data.reading_nm.tolist() == [0.1, 5.2, 10.1, 5.4, 0.2]
    assert data.branch.tolist() == [1, 1, 1, -1, -1]
    assert data.range_nm == 10.0
    assert not data.simulated


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t").replace(".", ","),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        "\N{ZERO WIDTH NO-BREAK SPACE}" + GOOD,
        GOOD.encode("utf-16"),
        GOOD.replace("reading_nm", " Reading_Nm ").replace(",", " , "),
        "# a comment\n\n" + GOOD.replace("5.2,5.0,1\n", "5.2,5.0,1\n# another, with commas\n\n"),
        GOOD.replace("\n", ",\n"),
        GOOD.replace("5.2", '"5.2"'),
        GOOD.rstrip("\n"),
        "operator,reading_nm,standard_nm,series\n"
        + "".join(f"Ana,{line}\n" for line in GOOD.splitlines()[1:]),
    ],
    ids=[
        "semicolons",
        "tabs",
        "semicolons and decimal commas",
        "tabs and decimal commas",
        "Windows line ends",
        "old line ends",
        "byte order mark",
        "UTF-16",
        "blanks and capitals",
        "comments and blank lines",
        "a separator too many",
        "quotation marks",
        "no last line end",
        "other columns",
    ],
)
def test_tables_as_laboratories_write_them(read, text):
    assert read(text, range_nm=10.0).sha256() == read(GOOD, range_nm=10.0).sha256()


def test_kilo_and_millinewton_metres_are_converted(read):
    text = "reading_knm,standard_mnm\n0.0011,1000.0\n0.0021,2000.0\n"
    data = read(text, range_nm=10.0)
    np.testing.assert_allclose(data.reading_nm, [1.1, 2.1])
    np.testing.assert_allclose(data.standard_nm, [1.0, 2.0])


def test_other_units_of_a_kind_are_converted(read):
    text = "reading_lbft,standard_nm,time_h,temperature_k\n1,1.36,1,300\n2,2.71,2,301\n"
    data = read(text, range_nm=10.0)
    np.testing.assert_allclose(data.reading_nm, [1.3558179483314004, 2.7116358966628009])
    np.testing.assert_allclose(data.time_s, [3600.0, 7200.0])
    np.testing.assert_allclose(data.temperature_c, [26.85, 27.85])


def test_a_column_without_a_name_does_not_matter(read):
    assert read("reading_nm,,standard_nm\n1.1,7,1\n").reading_nm.tolist() == [1.1]


def test_all_optional_columns_are_read(read):
    text = (
        "reading_nm,standard_nm,series,branch,direction,nominal_nm,position_deg,speed_rpm,"
        "temperature_c,time_s,standard_error_nm,true_torque_nm,zero_temperature_c,zero_nm,"
        "standard_temperature_c\n"
        "1.1,1.0,3,up,cw,1,120,10,23.5,0.5,0.01,0.99,22.5,-0.2,23\n"
        "-1.1,-1.0,3,down,counter-clockwise,-1,120,-10,23.5,1.0,0.01,-0.99,22.5,-0.2,24\n"
    )
    data = read(text)
    assert data.series.tolist() == [3, 3]
    assert data.branch.tolist() == [1, -1]
    assert data.position_deg.tolist() == [120.0, 120.0]
    assert data.speed_rpm.tolist() == [10.0, -10.0]
    assert data.temperature_c.tolist() == [23.5, 23.5]
    assert data.time_s.tolist() == [0.5, 1.0]
    assert data.nominal_nm.tolist() == [1.0, -1.0]
    assert data.standard_error_nm.tolist() == [0.01, 0.01]
    assert data.true_torque_nm.tolist() == [0.99, -0.99]
    assert data.zero_temperature_c.tolist() == [22.5, 22.5]
    assert data.zero_nm.tolist() == [-0.2, -0.2]
    assert data.standard_temperature_c.tolist() == [23.0, 24.0]
    assert data.simulated


@pytest.mark.parametrize(
    ("word", "branch"),
    [("up", 1), ("Down", -1), ("increasing", 1), ("dec", -1), ("+1", 1), ("-1", -1), ("0", 0)],
)
def test_branches_in_words_and_numbers(read, word, branch):
    assert read(f"reading_nm,standard_nm,branch\n1.1,1.0,{word}\n").branch.tolist() == [branch]


def test_comments_name_the_chain_and_arguments_take_precedence(read):
    text = "# range_nm = 20\n# Transducer_Serial: T-1\n# side = output,,\n" + GOOD
    data = read(text)
    assert (data.range_nm, data.transducer_serial, data.side) == (20.0, "T-1", "output")
    data = read(text, range_nm=10.0, transducer_serial="T-2")
    assert (data.range_nm, data.transducer_serial) == (10.0, "T-2")


def test_without_a_range_the_largest_torque_is_full_scale(read):
    assert read(GOOD.replace("10.1", "9.9")).range_nm == 10.0
    assert read(GOOD).range_nm == 10.0  # never from the readings


def test_simulated_tables_say_so(read):
    assert read("# simulated = true\n" + GOOD).simulated


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; allowed: a header line"),
        ("# only a comment\n\n", "is empty"),
        ("reading_nm,standard_nm\n", "a header but no values"),
        (b"\x89PNG\r\n\x1a\n\xff\xff", r"line 1: byte 0x89 isn't UTF-8"),
        (b"\x1f\x8b\x08\x00\x00", "is compressed"),
        (b"reading_nm,standard_nm\n1\x00,2\n", "line 2: a NUL character"),
        ("reading_nm,series\n1,1\n", "no column standard_nm; it has reading_nm, series"),
        ("reading,standard_nm\n1,1\n", "rename reading to reading_nm if it is in that unit"),
        ("reading_mv,standard_nm\n1,1\n", "reading_mv is an electrical signal in mV.*--sensitiv"),
        ("reading_mv_v,standard_nm\n1,1\n", "reading_mv_v is an electrical signal in mV/V"),
        ("reading_hz,standard_nm\n1,1\n", "reading_hz is an electrical signal in Hz"),
        ("reading_nm,standard_n\n1,1\n", "standard_n is a force in N.*--arm"),
        ("reading_percent,standard_nm\n1,1\n", "reading_percent is a share"),
        ("reading_nm,reading_knm,standard_nm\n1,1,1\n", "reading_nm and reading_knm give one"),
        (
            "reading_nm,standard_nm,reading_nm\n1,1,1\n",
            r"reading_nm \(1\) and reading_nm \(3\) give",
        ),
        (GOOD.replace("5.2", ""), "line 3, column reading_nm: an empty cell"),
        (GOOD.replace("5.2", "NaN"), r"line 3, column reading_nm: 'NaN'; .*measure the point"),
        (GOOD.replace("5.2", "inf"), "line 3, column reading_nm: 'inf'; allowed: a finite number"),
        (GOOD.replace("5.2", "1e999"), "line 3, column reading_nm: '1e999'"),
        (GOOD.replace("5.2", "5.2 Nm"), "line 3, column reading_nm: '5.2 Nm'; allowed: a number"),
        (GOOD.replace("5.2", "١"), "line 3, column reading_nm: '١'"),
        (GOOD.replace("5.2", "1_0"), "line 3, column reading_nm: '1_0'"),
        (GOOD.replace("5.2", "5,2"), "line 3: 4 values in a table of 3 .*decimal commas"),
        (GOOD.replace("5.2,", ""), "line 3: 2 values in a table of 3"),
        (GOOD.replace("5.2", '"5.2'), "matching quotation marks"),
        (
            GOOD.replace(",", ";").replace("5.4", "5,4"),
            "commas and points mixed: '5,4' in .*line 5, column reading_nm, but '0.1' in .*line 2",
        ),
        (GOOD.replace(",", ";").replace("10.1", "1.010,1"), "'1.010,1'.*thousands separators"),
        (GOOD.replace("5.2,5.0,1", "5.2,5.0,1.5"), "column series: '1.5'"),
        ("reading_nm,standard_nm,branch\n1,1,sideways\n", "'sideways'; allowed: up, down"),
        ("reading_nm,standard_nm,branch\n1,1,\n", "column branch: an empty cell"),
        ("reading_nm,standard_nm,direction\n1,1,ccw\n", r"'ccw' beside 1 N·m.*minus sign"),
        ("reading_nm,standard_nm\n0,0\n", "all standard values are 0"),
        ("# range_nm = large\n" + GOOD, "range_nm = 'large'"),
        (GOOD + "5.2,5.0,1\n", r"line 7 repeats line 3, at 5 N·m of series 1"),
        (GOOD + "5.7,5.0,1\n", r"line 7 reads 5.7 N·m where line 3 reads 5.2 N·m"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_place(read, text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"can't read .*missing\.csv: No such file"):
        read_calibration(tmp_path / "missing.csv")
    with pytest.raises(InputError, match="can't read"):
        read_calibration(tmp_path)


def test_values_beyond_the_range_are_named_with_their_line(read):
    with pytest.raises(InputError, match=r"line 4, column standard_nm: 10 N·m exceeds.*±5\.1"):
        read(GOOD.replace("5.2,", "5.0,").replace("5.4,", "5.1,"), range_nm=5.0)


def test_repeated_series_are_no_duplicates_and_neither_are_zeros_after_either_direction(read):
    assert len(read(GOOD + GOOD.split("\n", 1)[1].replace(",1\n", ",2\n"))) == 10
    cycle = "reading_nm,standard_nm\n5.1,5\n0.1,0\n-5.1,-5\n-0.1,0\n"
    assert len(read(cycle)) == 4


def test_one_direction_is_enough_unless_both_are_asked_for(read):
    assert read(GOOD).notes() == (
        "only clockwise points: nothing is known of counter-clockwise torque",
    )
    with pytest.raises(InputError, match=r"no counter-clockwise \(negative\) torque"):
        read(GOOD, both_directions=True)


finite = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(st.data(), st.integers(1, 20), st.booleans(), st.booleans())
def test_written_tables_are_read_back_exactly(tmp_path_factory, data, n, optional, simulated):
    column = npst.arrays(np.float64, n, elements=finite)
    spread = column.filter(lambda values: values.size < 3 or np.ptp(values) > 0.0)
    reading, standard = data.draw(spread), data.draw(spread)
    table = CalibrationData(
        reading_nm=reading,
        standard_nm=standard,
        series=np.arange(n),
        branch=data.draw(npst.arrays(np.int8, n, elements=st.integers(-1, 1))),
        range_nm=float(max(1e-3, np.max(np.abs(standard)), np.max(np.abs(reading)))),
        side="output",
        transducer_serial="T-1",
        counter_identity="C-1",
        simulated=simulated,
        temperature_c=data.draw(column) if optional else None,
        true_torque_nm=data.draw(column) if optional and simulated else None,
        position_deg=data.draw(column) if optional else None,
    )
    path = tmp_path_factory.getbasetemp() / "round_trip.csv"
    write_calibration(path, table, {"profile": "rapid-in-situ"})
    again = read_calibration(path)
    assert again.sha256() == table.sha256()
    assert again.simulated == table.simulated


@given(
    st.one_of(
        st.text(),
        st.binary(),
        st.lists(
            st.lists(
                st.sampled_from(
                    ["reading_nm", "standard_nm", "series", "branch", "1", "2.5", "3,5", '"', "nan"]
                ),
                min_size=1,
                max_size=4,
            ).map(";".join),
            max_size=6,
        ).map(lambda lines: "\n".join(["reading_nm;standard_nm", *lines])),
    )
)
def test_whatever_a_file_holds_it_is_a_table_or_an_input_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "anything.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    for reader in (read_calibration, read_readings):
        try:
            table = reader(path)
        except InputError:
            continue
        assert len(table) >= 1
