from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests.system.command_line import run

from torquebench.records import Registry, RunFolder, RunSummary
from torquebench.signals import EdgeBlock


@pytest.fixture
def run_id(tmp_path: Path) -> str:
    data = tmp_path / "data"
    data.mkdir()
    Registry.open(data).close()
    with RunFolder.create(data / "runs", {"simulated": True}, kind="measure") as writer:
        writer.samples({"time_s": np.arange(4.0), "output_torque_nm": np.arange(4.0) * 10.0})
        writer.edges({"output_torque": EdgeBlock(np.array([3, 1670, 3337]), 0, 5000, 100e6)})
    summary = RunSummary(
        run_id=writer.run_id,
        kind="measure",
        started=datetime.now(UTC),
        simulated=True,
        software_version="1",
        folder=writer.path,
    )
    with Registry.open(data) as registry:
        registry.add_run(summary)
        registry.end_run(writer.folder)
    return writer.run_id


def test_samples_and_edges_are_exported(tmp_path: Path, run_id: str) -> None:
    options = ("--data", "data", "--out")
    done = run("records", "export-data", "latest", *options, "samples.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "samples.csv").read_text()
    assert f"# run_id: {run_id}" in text
    assert "# simulated: True" in text
    assert "# unit of output_torque_nm: N·m" in text
    wanted = ("--format", "parquet", "--stream", "edges")
    done = run("records", "export-data", run_id, *options, "e.parquet", *wanted, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert pq.read_table(tmp_path / "e.parquet")["tick"].to_pylist() == [3, 1670, 3337]


def test_bad_input_is_one_message(tmp_path: Path, run_id: str) -> None:
    options = ("--data", "data", "--out")
    for arguments, message in (
        (("nothing", *options, "a.csv"), "no run 'nothing'"),
        ((run_id, *options, "missing/a.csv"), "there is no folder"),
        ((run_id, *options, "a.csv", "--format", "xls"), "xls"),
    ):
        done = run("records", "export-data", *arguments, cwd=tmp_path)
        assert done.returncode == 2, done.stdout
        assert message in done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "a.csv").exists()
