"""Who may open a bench: one command at a time, and simulated instruments that have to be there."""

import os
import re
from pathlib import Path

from tests.system.command_line import run

from torquebench.bench.description import default_bench
from torquebench.records import Registry
from torquebench.station.bench_lock import BenchLock

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def test_a_second_command_is_told_who_has_the_bench(tmp_path: Path) -> None:
    lock = BenchLock(default_bench(), tmp_path / "data")
    Registry.open(tmp_path / "data").close()
    refused = run("calibrate", "output", "--data", "data", cwd=tmp_path, COLUMNS="80")
    assert refused.returncode == 2
    said = " ".join(refused.stderr.split())
    assert "the records in data are in use by" in said
    assert f"(process {os.getpid()} on" in said
    assert "wait until that process ends" in said
    assert run("records", "list", "--data", "data", cwd=tmp_path).returncode == 0
    assert run("panel", "--port", 0, "--data", "data", cwd=tmp_path).returncode == 2
    lock.release()


def test_simulators_that_do_not_run_are_named_with_their_command(tmp_path: Path) -> None:
    text = (EXAMPLES / "networked.toml").read_text(encoding="utf-8")
    bench = tmp_path / "bench.toml"  # port 1: nobody answers there
    bench.write_text(re.sub(r'(control = "127\.0\.0\.1:)\d+', r"\g<1>1", text), encoding="utf-8")
    failed = run("calibrate", "output", "--bench", bench, cwd=tmp_path, COLUMNS="80")
    assert failed.returncode == 1
    said = " ".join(failed.stderr.split())
    assert "are simulated, and no simulators answer" in said
    assert "`torquebench simulate --bench FILE`" in said
