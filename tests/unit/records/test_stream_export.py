import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from asammdf import MDF
from nptdms import TdmsFile

from torquebench.errors import InputError
from torquebench.records import RunFolder
from torquebench.records.export.streams import STREAM_FORMATS, export_streams
from torquebench.signals import EdgeBlock

ROWS = 30
TIMEBASE_HZ = 100e6
Read = tuple[dict[str, np.ndarray], dict[str, str], dict[str, str]]


def samples() -> dict[str, np.ndarray]:
    draw = np.random.default_rng(1)
    torque = draw.normal(0.0, 1000.0, ROWS)
    torque[7] = np.nan
    return {
        "time_s": 3.005 + 0.01 * np.arange(ROWS),
        "output_torque_hz": 60e3 + 15.0 * torque,
        "output_torque_nm": torque,
        "output_torque_fault": np.where(np.isnan(torque), 1, 0).astype(np.uint8),
        "output_angle_counts": np.arange(ROWS, dtype=np.int64) - 10,
        "output_speed_rad_s": np.full(ROWS, 0.25),
        "ambient_c": np.full(ROWS, 23.125),
    }


UNITS = {
    "time_s": "s",
    "output_torque_hz": "Hz",
    "output_torque_nm": "N·m",
    "output_angle_counts": "counts",
    "output_speed_rad_s": "rad/s",
    "ambient_c": "°C",
}
RISING = np.cumsum(np.random.default_rng(2).integers(1600, 1730, 5000))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    transducer = {"transducer": {"serial": "T-1"}, "encoder": {"counts_per_revolution": 3600}}
    known = {"operator": "Ana & Bo <lab>", "simulated": True, "bench": {"output": transducer}}
    with RunFolder.create(tmp_path_factory.mktemp("runs"), known, kind="export") as writer:
        columns = samples()
        for rows in (slice(0, 13), slice(13, ROWS)):
            writer.samples({name: values[rows] for name, values in columns.items()})
        border = int(RISING[2000]) + 1
        for start, stop in ((0, border), (border, int(RISING[-1]) + 1)):
            rising = RISING[(start <= RISING) & (stop > RISING)]
            writer.edges(
                {
                    "timed": EdgeBlock(rising, start, stop, TIMEBASE_HZ),
                    "silent": EdgeBlock(rising[:0], start, stop, TIMEBASE_HZ),
                }
            )
    return writer.folder


def read_csv(path: Path) -> Read:
    comments = [line[2:] for line in path.read_text().splitlines() if line.startswith("# ")]
    said = dict(line.split(": ", 1) for line in comments)
    units = {key.removeprefix("unit of "): said[key] for key in said if key.startswith("unit of ")}
    options = pyarrow.csv.ReadOptions(skip_rows=len(comments))
    table = pyarrow.csv.read_csv(path, read_options=options)
    return columns_of(table), units, said


def read_parquet(path: Path) -> Read:
    table = pq.read_table(path)
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema
    }
    said = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    return columns_of(table), units, said


def columns_of(table: pa.Table) -> dict[str, np.ndarray]:
    return {name: table.column(name).to_numpy() for name in table.column_names}


def read_hdf5(path: Path) -> Read:
    with h5py.File(path) as file:
        said = {key: str(value) for key, value in file.attrs.items()}
        found: dict[str, h5py.Dataset] = {}
        file.visititems(
            lambda name, item: (
                found.update({name: item}) if isinstance(item, h5py.Dataset) else None
            )
        )
        names = {name: name.removeprefix("samples/") for name in found}
        columns = {names[name]: item[:] for name, item in found.items()}
        return columns, {names[name]: item.attrs["unit"] for name, item in found.items()}, said


def read_tdms(path: Path) -> Read:
    file = TdmsFile.read(path)
    channels = file.groups()[0].channels()
    columns = {channel.name: channel[:] for channel in channels}
    units = {channel.name: channel.properties["unit_string"] for channel in channels}
    return columns, units, {key: str(value) for key, value in file.properties.items()}


def read_mdf4(path: Path) -> Read:
    with MDF(path) as file:
        signals = [
            file.get(group=number, index=index)
            for number, group in enumerate(file.groups)
            for index in range(1, len(group.channels))
        ]
        columns = {signal.name: signal.samples for signal in signals}
        columns["time_s"] = signals[0].timestamps
        units = {signal.name: signal.unit for signal in signals} | {"time_s": "s"}
        said = {key: str(value) for key, value in file.header._common_properties.items()}
        return columns, units, said


READERS: dict[str, Callable[[Path], Read]] = {
    "csv": read_csv,
    "parquet": read_parquet,
    "hdf5": read_hdf5,
    "tdms": read_tdms,
    "mdf4": read_mdf4,
}


@pytest.mark.parametrize("file_format", STREAM_FORMATS)
def test_samples_come_back_with_units_and_attributes(
    run: RunFolder, tmp_path: Path, file_format: str
) -> None:
    path = tmp_path / "any name.data"
    export_streams(run, path, file_format)  # type: ignore[arg-type]
    columns, units, said = READERS[file_format](path)
    for name, expected in samples().items():
        np.testing.assert_array_equal(np.asarray(columns[name]), expected, err_msg=name)
    assert {name: units[name] for name in UNITS} == UNITS
    assert said["run_id"] == run.run_id
    assert said["operator"] == "Ana & Bo <lab>"
    assert said["simulated"] == "True"
    assert said["output_transducer_serial"] == "T-1"
    assert said["output_counts_per_revolution"] == "3600"
    assert said["raw.parquet_sha256"] == run.manifest["files"]["raw.parquet"]["sha256"]
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("file_format", STREAM_FORMATS)
def test_edges_come_back_to_the_tick(run: RunFolder, tmp_path: Path, file_format: str) -> None:
    path = tmp_path / "edges"
    export_streams(run, path, file_format, "edges")  # type: ignore[arg-type]
    columns, _, said = READERS[file_format](path)
    assert said["stream"] == "edges"
    if file_format in ("csv", "parquet"):
        ticks = columns["tick"][(columns["channel"] == "timed") & (columns["edge"] == "rising")]
        assert set(columns["timebase_hz"]) == {TIMEBASE_HZ}
    else:
        ticks = columns["edges/timed/rising" if file_format == "hdf5" else "timed rising"]
    np.testing.assert_array_equal(ticks, RISING)


def test_what_a_run_does_not_have_is_refused(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "runs", {}, kind="empty").seal()
    with pytest.raises(InputError, match="has no samples"):
        export_streams(folder, tmp_path / "a.csv", "csv")
    with pytest.raises(InputError, match=r"has no edges.*edges = true"):
        export_streams(folder, tmp_path / "a.csv", "csv", "edges")
    assert not list(tmp_path.glob("*.csv"))


def test_a_file_that_cannot_be_written_is_named(run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="can't write"):
        export_streams(run, tmp_path / "missing" / "a.csv", "csv")


def test_an_unsealed_run_says_so(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path / "runs", {}, kind="open")
    writer.samples({"time_s": np.arange(3.0)})
    writer.close()
    export_streams(writer.folder, tmp_path / "open.csv", "csv")
    assert "# status: not sealed" in (tmp_path / "open.csv").read_text()
    assert json.loads((writer.path / "run.json").read_text())["kind"] == "open"
