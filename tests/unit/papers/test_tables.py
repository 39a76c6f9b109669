"""Folders of recorded tables: what is written is read back, and what can't be used is named."""

from pathlib import Path

import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter

from torquebench.bench.certificates.torque import ReferenceCertificate
from torquebench.calibration import CalibrationData
from torquebench.errors import InputError
from torquebench.papers.factors import FactorError
from torquebench.papers.tables import (
    BenchTables,
    FrictionTable,
    ModuleTables,
    ReducerValue,
    read_tables,
    write_tables,
)


def calibration(scale: float = 2000.0, groups: int = 1) -> CalibrationData:
    torque = np.tile(np.linspace(-1.0, 1.0, 21) * scale, groups)
    return CalibrationData(
        torque * (1.0 + 2e-3) + 1e-6 * torque**2 / scale,
        torque,
        np.repeat(np.arange(1, groups + 1), 21),
        np.where(np.tile(np.arange(21), groups) < 10, -1, 1),
        scale,
        side="output",
        nominal_nm=torque,
    )


def tables() -> BenchTables:
    certificate = ReferenceCertificate(
        np.array([-2000.0, 0.0, 2000.0]), np.array([0.1, 0.0, -0.1]), np.full(3, 0.02)
    )
    module = ModuleTables(
        calibration(), calibration(groups=2), None, calibration(), certificate, np.eye(4)
    )
    speed = np.array([100.0, 200.0, 100.0, 200.0])
    friction = FrictionTable(
        speed,
        0.3 + 1e-4 * speed,
        np.array([1, 1, 2, 2]),
        np.array([1, 1, 1, 1]),
        0.3 + 1e-4 * speed,
        np.full(4, 0.005),
    )
    return BenchTables(
        "a bench",
        False,
        {"output": module},
        friction,
        {"guide rail": "linear, 600 mm"},
        (ReducerValue("Starting torque", "starting torque, clockwise", 0.33, 0.26, "N·m"),),
        (FactorError("output", "turning, oil", 12, 0.65, 0.06, 0.03),),
    )


def test_a_written_folder_is_read_back(tmp_path: Path) -> None:
    written = write_tables(tmp_path / "saved", tables())
    assert [path.name for path in written] == [
        "calibration-output.csv",
        "same-points-output.csv",
        "alone-output.csv",
        "certificate-output.csv",
        "staircase-output.csv",
        "bench.csv",
        "reducer.csv",
        "factors.csv",
        "friction-standard-reducer.csv",
    ]
    found = read_tables([tmp_path / "saved"])
    assert (found.name, found.simulated) == ("a bench", False)
    module, expected = found.modules["output"], tables().modules["output"]
    assert module.other_points is None
    for name in ("calibration", "same_points", "alone"):
        np.testing.assert_array_equal(
            getattr(module, name).reading_nm, getattr(expected, name).reading_nm
        )
    assert module.certificate is not None
    np.testing.assert_array_equal(module.certificate.error_nm, [0.1, 0.0, -0.1])
    assert module.staircase is not None
    np.testing.assert_array_equal(module.staircase, np.eye(4))
    for name in ("facts", "reducer", "factors"):
        assert getattr(found, name) == getattr(tables(), name)
    assert found.friction is not None
    np.testing.assert_array_equal(found.friction.known_nm, tables().friction.known_nm)


def test_tdms_is_read_as_csv_is(tmp_path: Path) -> None:
    data = calibration()
    channels = {
        "reading_nm": data.reading_nm,
        "standard_nm": data.standard_nm,
        "series": data.series,
        "branch": data.branch.astype(np.int64),
    }
    with TdmsWriter(tmp_path / "calibration-output.tdms") as writer:
        root = RootObject({"range_nm": 2000.0})
        writer.write_segment([root, *(ChannelObject("points", n, v) for n, v in channels.items())])
    found = read_tables([tmp_path]).modules["output"].calibration
    assert found.range_nm == 2000.0
    np.testing.assert_array_equal(found.reading_nm, data.reading_nm)
    np.testing.assert_array_equal(found.branch, data.branch)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "no calibration"),
        ({"same-points-input.csv": "reading_nm,standard_nm\n1,1\n2,2\n"}, "without calibration-in"),
        ({"calibration-input.tdms": "no TDMS"}, "calibration-input.tdms: no group"),
        (
            {
                "calibration-input.csv": "reading_nm,standard_nm\n1,1\n2,2\n3,3\n",
                "friction-standard-reducer.csv": "speed_rpm,reading_nm\n100,0.3\n",
            },
            "no column known_nm",
        ),
        (
            {
                "calibration-input.csv": "reading_nm,standard_nm\n1,1\n2,2\n3,3\n",
                "bench.csv": "item,value\nguide rail\n",
            },
            "1 cells",
        ),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, files: dict[str, str], message: str) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_tables([tmp_path])
