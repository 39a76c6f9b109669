"""Tables of others, 60 of each kind, drawn at random and judged by what they were written from.

The judge knows the definitions of units (NIST SP 811, appendix B) and what it wrote into a file; it
shares nothing with the reader.
"""

import csv
import io
import random
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat
from tests.support.draws import drawn

from torquebench.campaign.dynamics import identify_dynamics
from torquebench.compensation import (
    PolynomialModel,
    Provenance,
    StoredModel,
    features,
    save_model,
)
from torquebench.errors import InputError, ModelMismatchError
from torquebench.tables import (
    Conversion,
    TableColumns,
    check_model,
    compensate_file,
    model_conversion,
    read_calibration,
    read_calibration_table,
    read_empty_run,
    read_readings,
    read_table,
    table_of_arrow,
    understand,
)

MANY = 60
STANDARD = [0.0, 20.0, 50.0, 80.0, 50.0, 20.0, 0.0]
READING = [0.02, 20.05, 50.11, 80.2, 50.2, 20.12, 0.04]
TORQUES = {
    # N·m of one, by its spellings (NIST SP 811, appendix B.8)
    1.0: ("N·m", "Nm", "N m", "N*m", "N.m", "N-m", "newton meter", "N⋅m", "牛米"),
    1e3: ("kN·m", "kNm", "kN m", "kN.m"),
    1e6: ("MN·m", "MNm", "MN m"),
    1e-3: ("mN·m", "mNm", "mN m", "N·mm", "N mm", "Nmm"),
    1e-6: ("µN·m", "μNm", "uNm"),
    1e-2: ("N·cm", "Ncm", "cN·m", "cNm"),
    1.3558179483314004: ("lbf·ft", "lbf-ft", "ft·lbf", "ft-lb", "ft lb", "lb-ft", "ft.lbf"),
    0.1129848290276167: ("lbf·in", "in·lbf", "in-lb", "lb-in", "inlb", "lbf in"),
    7.0615518142260e-3: ("ozf·in", "oz·in", "oz-in", "in-oz", "ozf in"),
    9.80665: ("kgf·m", "kgf m", "kgm", "kp·m", "kgf-m"),
    9.80665e-2: ("kgf·cm", "kg·cm", "kgf cm", "kg-cm", "kgcm"),
    9.80665e-5: ("gf·cm", "g·cm", "gcm"),
    1e-7: ("dyn·cm", "dyn cm"),
}
OTHERS = {
    "speed": {
        1.0: ("rpm", "1/min", "min⁻¹", "r/min", "U/min", "rev/min", "min^-1", "RPM"),
        60.0: ("rps", "1/s", "rev/s", "U/s", "Hz", "r/s"),
        9.549296585513721: ("rad/s", "rad s^-1", "rad·s⁻¹"),
        0.16666666666666666: ("°/s", "deg/s", "dps"),
    },
    "temperature": {(1.0, 0.0): ("°C", "degC", "C"), (1.0, -273.15): ("K", "kelvin"),
                    (5 / 9, -160 / 9): ("°F", "degF", "F")},
    "time": {1.0: ("s", "sec", "seconds"), 1e-3: ("ms", "msec"), 60.0: ("min", "minutes"),
             3600.0: ("h", "hours"), 1e-6: ("µs", "us")},
    "position": {1.0: ("°", "deg", "degrees", "Grad"), 57.29577951308232: ("rad",),
                 1 / 60: ("arcmin", "′"), 360.0: ("rev", "turns"), 0.05729577951308232: ("mrad",)},
}  # fmt: skip
FORCES = {1.0: "N", 1e3: "kN", 4.4482216152605: "lbf", 9.80665: "kgf", 0.27801385095378125: "ozf"}
MASSES = {1.0: "kg", 1e-3: "g", 0.45359237: "lb", 1e3: "t"}
LENGTHS = {1.0: "m", 1e-3: "mm", 1e-2: "cm", 0.0254: "in", 0.3048: "ft"}
WORDS = {
    # usual words of instruments' exports and certificates: reading, standard
    "en": (("Reading", "Indicated torque", "UUT", "Measured", "DUT reading", "Indication",
            "Measured value", "Transducer reading", "IUT"),
           ("Applied", "Applied torque", "Reference", "STD", "Standard", "True value", "Ref torque",
            "Reference value", "Calibrator")),
    "de": (("Anzeige", "Messwert", "Istwert", "Prüfling", "Angezeigtes Drehmoment", "Ablesung"),
           ("Bezug", "Bezugsnormal", "Referenz", "Normal", "Referenzdrehmoment",
            "Angelegtes Drehmoment", "Bezugsmoment")),
    "zh": (("示值", "测量值", "读数", "被测扭矩", "实测值"),
           ("标准值", "标准扭矩", "参考值", "标准器", "施加扭矩")),
    "fr": (("Lecture", "Couple mesuré", "Indication", "Valeur lue", "Couple indiqué"),
           ("Couple de référence", "Référence", "Couple appliqué", "Étalon", "Couple étalon")),
    "es": (("Lectura", "Par medido", "Indicación", "Par indicado", "Valor leído"),
           ("Par de referencia", "Referencia", "Par aplicado", "Patrón", "Valor patrón")),
    "ja": (("指示値", "測定値", "読み値", "測定トルク", "表示値"),
           ("基準値", "基準トルク", "標準値", "参照トルク", "印加トルク")),
}  # fmt: skip


def written(
    path: Path, header: list[str], columns: list[list[float]], separator: str = ","
) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, delimiter=separator)
        table.writerow(header)
        table.writerows(zip(*columns, strict=True))
    return path


def spelled(draw: random.Random, name: str, unit: str) -> str:
    return draw.choice(("{} [{}]", "{} ({})", "{} in {}", "{}, {}", "{} / {}")).format(name, unit)


def scaled(values: list[float], factor: float, offset: float = 0.0) -> list[float]:
    return [(value - offset) / factor for value in values]


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_every_unit_of_torque_in_every_place(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    pairs = [(factor, draw.choice(TORQUES[factor])) for factor in draw.sample([*TORQUES], 2)]
    columns = [
        scaled(values, factor)
        for values, (factor, _) in zip((READING, STANDARD), pairs, strict=True)
    ]
    names = draw.choice((("reading", "standard"), ("UUT", "Applied"), ("Anzeige", "Referenz")))
    header = [spelled(draw, name, unit) for name, (_, unit) in zip(names, pairs, strict=True)]
    mapping: list[str] = []
    if seed % 3 == 1:  # a row of units
        header = [*names]
        columns = [[unit, *column] for column, (_, unit) in zip(columns, pairs, strict=True)]  # type: ignore[list-item]
    elif seed % 3 == 2:  # by option
        header = ["Kanal 1", "Kanal 2"]
        mapping = [
            f"{quantity}={name}[{unit}]"
            for quantity, name, (_, unit) in zip(
                ("reading", "standard"), header, pairs, strict=True
            )
        ]
    data = read_calibration(written(tmp_path / "t.csv", header, columns, ";"), mapping=mapping)
    assert data.reading_nm == pytest.approx(READING, rel=1e-9)
    assert data.standard_nm == pytest.approx(STANDARD, rel=1e-9)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_every_unit_of_what_stands_beside(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    kind = [*OTHERS][seed % len(OTHERS)]
    factor = draw.choice([*OTHERS[kind]])  # type: ignore[call-overload]
    unit = draw.choice(OTHERS[kind][factor])  # type: ignore[index]
    ratio, offset = factor if isinstance(factor, tuple) else (factor, 0.0)
    values = [20.0 + number for number in range(len(READING))]
    header = ["reading_nm", "standard_nm", spelled(draw, kind, unit)]
    path = written(
        tmp_path / "t.csv", header, [READING, STANDARD, scaled(values, ratio, offset)], "\t"
    )
    data = read_calibration(path)
    found = {
        "speed": data.speed_rpm,
        "temperature": data.temperature_c,
        "time": data.time_s,
        "position": data.position_deg,
    }[kind]
    assert found == pytest.approx(values, rel=1e-9), header


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_header_and_option_that_contradict_are_refused(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    first, second = draw.sample([*TORQUES], 2)
    stated, option = draw.choice(TORQUES[first]), draw.choice(TORQUES[second])
    name = draw.choice(("UUT", "Kanal 1", "Torque", "M"))
    header = f"{name} [{stated}]" if seed % 2 else f"{name} ({stated})"
    path = written(tmp_path / "t.csv", [header, "standard_nm"], [READING, STANDARD])
    with pytest.raises(InputError, match=r"the header .* is in"):
        read_calibration(path, mapping=[f"reading={name}[{option}]"])


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_one_header_for_two_quantities_is_refused(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    words = WORDS[[*WORDS][seed % len(WORDS)]][seed // 6 % 2]
    name = spelled(draw, draw.choice(words), "N·m")
    names = [name, name] if seed % 2 else [name, "standard_nm"]
    path = written(tmp_path / "t.csv", names, [READING, STANDARD])
    with pytest.raises(InputError):
        read_calibration(path, mapping=[f"reading={name}", f"standard={name}"])
    if seed % 2:
        with pytest.raises(InputError):
            read_calibration(path)


@pytest.mark.parametrize(
    ("language", "reading", "standard"),
    [
        (language, readings[number % len(readings)], standards[number % len(standards)])
        for language, (readings, standards) in WORDS.items()
        for number in range(10)
    ],
)
def test_the_usual_words(tmp_path: Path, language: str, reading: str, standard: str) -> None:
    header = [f"{standard} [N·m]", f"{reading} [N·m]"]
    data = read_calibration(written(tmp_path / f"{language}.csv", header, [STANDARD, READING]))
    assert data.standard_nm.tolist() == STANDARD
    assert data.reading_nm.tolist() == READING


TITLES = (
    ["Calibration report", "Customer;ACME", "Date;2026-03-02"],
    ["Prüfprotokoll 17", "", "Prüfer: Müller", "Temperatur: 21,3 °C"],
    ["2026/03/02 10:11:12"],
    ["Torque test", "Range;100;N·m", "Operator;A. B.", "Serial;4711"],
    ["校准记录", "日期;2026-03-02"],
    ['"A title\nof two lines"', "No. 5"],
)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_where_the_table_begins(tmp_path: Path, seed: int) -> None:
    """Title blocks, rows of units, separators, decimal marks, encodings, quoted line ends."""
    draw = random.Random(seed)
    separator = draw.choice(";\t,")
    comma = separator != "," and draw.random() < 0.5
    names, units = ["Applied", "UUT", "Remark"], ["N·m", "N·m", ""]
    lines = [line.replace(";", separator) for line in draw.choice(TITLES)] if seed % 4 else []
    if comma:
        lines = [line.replace(".", ",") for line in lines]
    blank = draw.random() < 0.5
    lines += [""] * blank
    if seed % 2:
        lines += [separator.join(names), separator.join(draw.choice((units, ["[Nm]", "[Nm]", ""])))]
    else:
        named = [
            f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)
        ]
        lines.append(separator.join(named))
    first = sum(line.count("\n") + 1 for line in lines) + 1
    for row, (standard, reading) in enumerate(zip(STANDARD, READING, strict=True)):
        cells = [f"{standard:.2f}", f"{reading:.3f}", '"two\nlines"' if row == 2 else "ok"]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    ends = draw.choice(("\n", "\r\n"))
    text = ends.join(lines) + ends * draw.randrange(3)
    encodings = ["utf-8", "utf-8-sig", "utf-16"] if not text.isascii() else ["utf-8", "cp1252"]
    path = tmp_path / "t.csv"
    path.write_bytes(text.encode(draw.choice(encodings)))
    data = read_calibration(path)
    assert data.standard_nm.tolist() == STANDARD
    assert data.reading_nm.tolist() == READING
    bad = tmp_path / "bad.csv"
    at = draw.randrange(len(READING))
    value = f"{READING[at]:.3f}".replace(".", "," if comma else ".")
    bad.write_text(text.replace(f"{separator}{value}{separator}", f"{separator}oops{separator}"))
    line = first + at + (at > 2)  # a cell of two lines stands in the third row
    with pytest.raises(InputError, match=f"line {line}, column UUT.*oops"):
        read_calibration(bad)


def write_matlab73(path: Path, variables: dict[str, Any]) -> None:
    """Write MATLAB 7.3: HDF5 behind 512 bytes, arrays by columns, texts as numbers."""

    def put(group: h5py.Group, name: str, value: Any) -> None:
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, each in value.items():
                put(inner, key, each)
            return
        if isinstance(value, str):
            kind, data = "char", np.array([[ord(letter)] for letter in value], dtype="uint16")
        elif isinstance(value, list):
            cells = group.file.require_group("#refs#")
            for number, each in enumerate(value):
                put(cells, f"{name}{number}", each)
            references = [[cells[f"{name}{number}"].ref for number in range(len(value))]]
            kind, data = "cell", np.array(references, dtype=h5py.ref_dtype)
        else:
            array = np.atleast_2d(value)
            data = array if array.shape[0] == 1 else array.T
            kind = {"float64": "double", "bool": "logical"}.get(array.dtype.name, array.dtype.name)
            data = data.astype("uint8") if kind == "logical" else data
        stored = group.create_dataset(name, data=data)
        stored.attrs["MATLAB_class"] = np.bytes_(kind)

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            put(file, name, value)
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(content)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=2))
def test_files_of_matlab(tmp_path: Path, seed: int) -> None:
    """Version 5 by SciPy and 7.3 by h5py: structures, texts as long as the columns, cells."""
    draw = random.Random(seed)
    columns: dict[str, Any] = {
        "reading_nm": np.array(READING)[:, None],
        "standard_nm": np.array(STANDARD)[:, None],
    }
    text = "x" * draw.choice([1, 3, len(READING), 20])
    rest: dict[str, Any] = {"operator": text, "range_nm": 100.0}
    if draw.random() < 0.5:
        columns["ok"] = np.array([True] * len(READING))[:, None]
    variables = {**columns, **rest} if draw.random() < 0.5 else {"cal": columns, **rest}
    cells = draw.random() < 0.5
    path = tmp_path / "t.mat"
    if seed % 2:
        write_matlab73(path, variables | ({"names": ["a", "bc"]} if cells else {}))
    else:
        names = np.array(["a", "bc"], dtype=object)
        savemat(path, variables | ({"names": names} if cells else {}))
    found = read_calibration_table(path)
    assert found.data.reading_nm.tolist() == READING
    assert found.data.standard_nm.tolist() == STANDARD
    assert found.data.range_nm == 100.0
    assert list(found.columns.notes) == ["t.mat: not read: names"] * cells


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_exports_of_twincats_scope(tmp_path: Path, seed: int) -> None:
    """Channels with times of their own or shared ones, other sample times, ticks of 100 ns.

    The layout is that of the exports in the repositories pytcs and amci_resolver_issue.
    """
    draw = random.Random(seed)
    separator = draw.choice("\t;")
    comma, ticks, fast = (draw.random() < 0.5 for _ in range(3))
    shared = draw.random() < 0.5
    rows = draw.randrange(3, 30)
    torque = [round(draw.uniform(-50.0, 50.0), 3) for _ in range(rows)]
    speed = [draw.randrange(100) for _ in range(rows)]
    begin = 132_900_081_483_250_000

    def time(step: float, row: int) -> str:
        return str(begin + round(1e4 * step) * row) if ticks else f"{step * row:g}"

    channels: list[tuple[str, str, float, list[Any]]] = [
        ("Torque", "N·m (Torque)", 2.0, torque),
        ("Speed", "(None)", 2.0, speed),
    ]
    oversampled = ("Fast", "V (Voltage)", 0.5, [0.25 * n for n in range(4 * rows)])
    if fast:
        channels.insert(draw.randrange(3), oversampled)
    head: dict[str, list[str]] = {
        name: []
        for name in ("Name", "SymbolComment", "Data-Type", "SampleTime[ms]", "Unit", "Unit Offset")
    }
    columns: list[list[str]] = []
    before = None
    for name, unit, step, values in channels:
        cells = (name, "", "REAL64", f"{step:g}", unit, "0")
        if not (shared and before == step):
            for key in head:
                head[key].append(key)
            columns.append([time(step, row) for row in range(len(values))])
        for key, cell in zip(head, cells, strict=True):
            head[key].append(cell)
        columns.append([str(value) for value in values])
        before = step
    longest = max(map(len, columns))
    body = [
        [column[row] if row < len(column) else "" for column in columns] for row in range(longest)
    ]
    title = [
        ["Name", "A scope"],
        ["Starttime of export", str(begin), "Monday", "15:56:24.376"],
        [],
        [],
    ]
    lines = [separator.join(cells) for cells in (*title, *head.values(), [], *body)]
    path = tmp_path / "scope.csv"
    content = "\r\n".join(lines)
    path.write_text(content.replace(".", ",") if comma else content, encoding="utf-8")
    table = read_table(path)
    assert table.names == (f"time [{'s' if ticks else 'ms'}]", "Torque [N·m]", "Speed")
    np.testing.assert_allclose(table.numbers("Torque [N·m]"), torque)
    np.testing.assert_allclose(table.numbers("Speed"), speed)
    times = 2.0 * np.arange(rows) * (1e-3 if ticks else 1.0)
    found = table.numbers(0)
    np.testing.assert_allclose(found - found[0], times, atol=1e-6)
    assert [note for note in table.notes if note.endswith("other times: Fast")] != [] or not fast


UNUSED: tuple[tuple[Any, list[Any]], ...] = (
    (pa.dictionary(pa.int8(), pa.string()), ["a", "b"]),
    (pa.list_(pa.float64()), [[1.0], None]),
    (pa.list_(pa.list_(pa.int8()), 2), [[[1], [2]], None]),
    (pa.map_(pa.string(), pa.int64()), [[("a", 1)], None]),
    (pa.struct([("a", pa.int8())]), [{"a": 1}, None]),
    (pa.timestamp("ns", "UTC"), [datetime(2026, 3, 2, tzinfo=UTC), None]),
    (pa.timestamp("ms"), [datetime(2026, 3, 2), None]),
    (pa.duration("us"), [timedelta(seconds=1), None]),
    (pa.date32(), [date(2026, 3, 2), None]),
    (pa.time64("us"), [None, None]),
    (pa.bool_(), [True, None]),
    (pa.binary(), [b"\xff\x00", None]),
    (pa.binary(2), [b"ab", None]),
    (pa.null(), [None, None]),
    (pa.decimal128(38, 2), [Decimal("1.25"), None]),
    (pa.large_string(), ["x" * 1000, None]),
)


@pytest.mark.parametrize("kind", drawn(len(UNUSED), by_day=4))
def test_columns_of_any_type_matter_only_where_they_are_used(tmp_path: Path, kind: int) -> None:
    stored, values = UNUSED[kind]
    extra = pa.array((values * len(READING))[: len(READING)], stored)
    table = pa.table({"note": extra, "reading_nm": READING, "standard_nm": STANDARD})
    path = tmp_path / "t.parquet"
    pq.write_table(table, path)
    assert read_calibration(path).reading_nm.tolist() == READING
    used = table_of_arrow(table.rename_columns(["reading_nm", "x", "standard_nm"]), "a frame")
    with pytest.raises(InputError, match=r"reading_nm"):
        TableColumns(used, ("reading_nm",)).numbers(used, "reading_nm")


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_the_first_bad_cell_is_named_as_the_file_counts(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    ending = ("csv", "xlsx", "csv")[seed % 3] if seed % 10 else "xlsx"
    rows = draw.randrange(5, 400)
    blanks = sorted(draw.sample(range(1, rows), 2))
    bad = draw.randrange(rows)
    cell = draw.choice(("true", "n.a.", "12.5 N·m", "#REF!", "1,234,567.8", "--", "0x1F"))
    lines: list[list[Any]] = [["reading_nm", "standard_nm"]]
    expected = 0
    for row in range(rows):
        if row in blanks:
            lines.append([None, None])
        lines.append([float(row), cell if row == bad else float(row) + 0.25])
        expected = len(lines) if row == bad else expected
    path = tmp_path / f"t.{ending}"
    if ending == "xlsx":
        book = openpyxl.Workbook()
        book.active.title = "Data"
        book.create_sheet("Notes").append(["see Data"])
        for line in lines:
            book.active.append(line)
        book.save(path)
        place = rf"t\.xlsx#Data, row {expected}, column standard_nm"
    else:
        table = csv.writer(text := io.StringIO())
        table.writerows([["" if each is None else each for each in line] for line in lines])
        path.write_text(text.getvalue(), encoding="utf-8")
        place = rf"t\.csv, line {expected}, column standard_nm"
    source = f"{path}#Data" if ending == "xlsx" else path
    with pytest.raises(InputError, match=place):
        read_calibration(source)


@pytest.mark.parametrize("value", [True, False])
@pytest.mark.parametrize("kind", ["csv", "xlsx", "parquet"])
def test_truth_values_are_no_numbers(tmp_path: Path, kind: str, value: bool) -> None:
    path = tmp_path / f"t.{kind}"
    readings = [value, *READING[1:]]
    if kind == "csv":
        written(path, ["reading_nm", "standard_nm"], [readings, STANDARD])
    elif kind == "xlsx":
        book = openpyxl.Workbook()
        for row in (["reading_nm", "standard_nm"], *zip(readings, STANDARD, strict=True)):
            book.active.append(row)
        book.save(path)
    else:
        pq.write_table(pa.table({"reading_nm": [value] * 7, "standard_nm": STANDARD}), path)
    with pytest.raises(InputError, match=r"(?i)true|false"):
        read_calibration(path)


SIGNALS = {
    # mV/V, V, mA, Hz, counts of one
    "bridge": {1.0: "mV/V", 1e-3: "µV/V"},
    "voltage": {1.0: "V", 1e-3: "mV"},
    "current": {1.0: "mA"},
    "frequency": {1.0: "Hz", 1e3: "kHz"},
    "counts": {1.0: "counts"},
}


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_a_signal_times_its_sensitivity(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    units = SIGNALS[[*SIGNALS][seed % len(SIGNALS)]]
    factor, stated = draw.choice([*units]), draw.choice([*units])
    rated = draw.uniform(0.5, 1e4)
    zero = draw.uniform(-1, 1) * rated if seed % 2 else 0.0
    full = draw.choice((-1, 1)) * draw.uniform(50, 2000)
    unit, own = units[factor], units[stated]
    low, high = zero / stated, (zero + rated) / stated
    if seed % 2:
        text = f"{low!r} {own} at 0 N·m; {high!r} {own} at {full / 1e3!r} kN·m"
    elif seed % 4:
        text = f"{high!r} {own} at {full!r} N·m"
    else:
        text = f"{full / high!r} Nm per {own}"
    signal = [(zero + value / full * rated) / factor for value in READING]
    path = written(tmp_path / "t.csv", [f"UUT [{unit}]", "Applied [N·m]"], [signal, STANDARD], ";")
    read = read_calibration_table(path, conversion=Conversion.of_options(text, None, None))
    assert read.data.reading_nm == pytest.approx(READING, abs=1e-9 * abs(full) + 1e-9)
    assert read.columns.scale is not None
    assert read.columns.scale.unit == unit
    with pytest.raises(InputError, match="sensitivity"):
        read_calibration(path)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_a_force_or_mass_times_its_arm(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    units = MASSES if seed % 2 else FORCES
    factor, length = draw.choice([*units]), draw.choice([*LENGTHS])
    arm = draw.uniform(0.1, 2.0)
    gravity = draw.choice((None, 9.81, 9.7803)) if seed % 2 else None
    weight = (gravity or 9.80665) if seed % 2 else 1.0
    loads = [value / arm / weight / factor for value in STANDARD]
    name = "Mass" if seed % 2 else "Force"
    header = [f"Applied {name} [{units[factor]}]", "Reading [N·m]"]
    path = written(tmp_path / "t.csv", header, [loads, READING])
    stated = f"{arm / length!r}{' ' * (seed % 3)}{LENGTHS[length]}"
    data = read_calibration(path, conversion=Conversion.of_options(None, stated, gravity))
    assert data.standard_nm == pytest.approx(STANDARD, rel=1e-9)
    with pytest.raises(InputError, match="--arm"):
        read_calibration(path)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_a_hint_is_right_or_refused_and_never_takes_the_reference(
    tmp_path: Path, seed: int
) -> None:
    """What a refusal proposes reads the table right, or names what is missing next."""
    draw = random.Random(seed)
    factor = draw.choice([*TORQUES])
    unit = draw.choice(TORQUES[factor])
    words = [word for _, words in WORDS.values() for word in words]
    standard = draw.choice([*words, "負荷トルク", "Load torque", "Lastmoment"])
    other = draw.choice(("Ch1", "Kanal 3", "X", "Val", "AI0"))
    header = [f"{standard} [{unit}]", f"{other} [{unit}]"]
    path = written(
        tmp_path / "t.csv", header, [scaled(STANDARD, factor), scaled(READING, factor)], "|"
    )
    with pytest.raises(InputError) as refused:
        read_calibration(path)
    hint = str(refused.value.remedy)
    if "--column '" in hint and "=Header" not in hint:
        option = hint.split("--column '")[1].split("'")[0]
        assert standard not in option
        if standard in words:
            assert read_calibration(path, mapping=[option]).reading_nm == pytest.approx(READING)


MADE = Provenance(80.0, "output", "T-1", "C-1", "00" * 32, {}, "0.3.0", "2026-03-02T10:00:00Z")


@pytest.fixture(scope="module")
def stored() -> StoredModel:
    X = features(np.array(READING), branch=np.array([1, 1, 1, 1, -1, -1, -1]), series=0)
    return StoredModel(PolynomialModel(degree=1).fit(X, np.array(STANDARD)), MADE)


@pytest.mark.parametrize("seed", drawn(MANY, by_day=3))
def test_a_table_of_another_chain_than_the_models_is_refused_everywhere(
    tmp_path: Path, stored: StoredModel, seed: int
) -> None:
    """Transducer, counter, range and unit; what isn't stated can't differ."""
    draw = random.Random(seed)
    remarks = {"transducer_serial": "T-1", "counter_identity": "C-1", "range_nm": "80"}
    remarks = {name: value for name, value in remarks.items() if draw.random() < 0.7}
    unit, other = "N·m", ("transducer_serial", "counter_identity", "range_nm", "unit", "")[seed % 5]
    if other == "unit":
        unit = draw.choice(("mV/V", "kHz", "counts"))
        if seed % 2:
            made = replace(MADE, reading_scale=f"{unit}; 10.0; 0.0; stated")
            stored, unit = replace(stored, provenance=made), "N·m"
    elif other:
        remarks[other] = draw.choice(("T-11", "t-2", "Ü/3")) if other != "range_nm" else "200"
    lines = [f"# {name} = {value}" for name, value in remarks.items()]
    names = f"time_s,UUT [{unit}],Applied [N·m],speed_rpm,temperature_c"
    rows = [*zip(READING, STANDARD, strict=True)] * 4
    lines += [names, *(f"{n * 0.1:.1f},{r},{s},10,20" for n, (r, s) in enumerate(rows))]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    model = save_model(tmp_path / "m.json", stored)
    ways: list[Callable[[], object]] = [
        lambda: read_calibration_table(path, model=stored),
        lambda: read_empty_run(path, ("reading=UUT",), stored),
        lambda: compensate_file(
            path,
            tmp_path / "out.csv",
            lambda block: (block.reading_nm,) * 3,
            conversion=model_conversion(stored, Conversion()),
            check=lambda table, columns: check_model(stored, table, columns),
        ),
    ]
    if other:  # these rows identify no dynamics
        ways.append(lambda: identify_dynamics([path], model=model))
    for way in ways:
        if not other:
            way()
            continue
        with pytest.raises((InputError, ModelMismatchError), match=r"model|sensitivity"):
            way()
        assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("unit", ["[mV/V]", "in Hz", "_mV", "(counts)"])
def test_of_a_signal_and_a_torque_the_signal_is_proposed(tmp_path: Path, unit: str) -> None:
    header = ["mean_torque [Nm]", f"ch1{unit if unit[0] == '_' else f' {unit}'}", "Nominal [Nm]"]
    path = written(tmp_path / "t.csv", header, [STANDARD, READING, STANDARD])
    with pytest.raises(InputError) as refused:
        read_calibration(path)
    assert "reading=ch1" in str(refused.value.remedy)


@pytest.mark.parametrize(
    "text", [";;\n;;\n", '""', ",", '"', '"a\n' + "1,2\n" * 500, "# x\n", "\n", '";"\n', "a;b\n;\n"]
)
def test_a_text_without_cells_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"empty|no values|end of data"):
        read_calibration(path)


def test_an_empty_sheet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.xlsx"
    book = openpyxl.Workbook()
    book.save(path)
    with pytest.raises(InputError):
        read_calibration(path)
    book.active["C7"] = " "
    book.save(path)
    with pytest.raises(InputError):
        read_calibration(path)


def test_the_answer_names_what_was_understood(tmp_path: Path) -> None:
    path = written(
        tmp_path / "t.csv",
        ["Applied [lbf·ft]", "UUT (lbf·in)"],
        [STANDARD, scaled(READING, 1 / 12)],
    )
    described = read_calibration_table(path).columns.understood.described()
    assert [(c["name"], c["quantity"], c["unit"], c["to"]) for c in described] == [
        ("Applied [lbf·ft]", "standard", "lbf·ft", "N·m"),
        ("UUT (lbf·in)", "reading", "lbf·in", "N·m"),
    ]
    assert [c["factor"] for c in described] == pytest.approx(
        [1.3558179483314004, 0.1129848290276167]
    )


def test_readings_and_reducers_share_the_reader(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", ["UUT [ft-lb]", "Zeit [ms]"], [READING, STANDARD])
    assert read_readings(path).reading_nm == pytest.approx(np.multiply(READING, 1.3558179483314))
    table = table_of_arrow(pa.table({"Drehmoment [Nm]": READING, "Winkel [′]": STANDARD}), "t")
    found = understand(table, {"torque": "torque", "angle": "angle"}, ["torque", "angle"])
    assert found.numbers(table, "angle") == pytest.approx(np.radians(np.divide(STANDARD, 60)))
