"""What the certificate command refuses before it writes anything."""

from pathlib import Path

import pytest
import typer
from tests.unit.reports.calibrated_bench import calibrated_bench
from typer.testing import CliRunner

from torquebench.cli.certificate import with_check
from torquebench.cli.operations import operation_command
from torquebench.errors import InputError, TorquebenchError
from torquebench.operations import find_operation
from torquebench.operations.records import find_calibration
from torquebench.records import Registry


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "neither a calibration nor --check"),
        (("latest", "--check", "a.pdf"), "both, and --check"),
        (("--check", "nowhere.pdf"), "neither a file nor the code"),
        (("latest", "--number", "a/b"), "number"),
        (("latest", "--laboratory", "nowhere.toml"), "nowhere.toml"),
        (("no-such-run",), "no run 'no-such-run'"),
        (("calibration-99",), "calibration 99 isn't registered"),
        (("latest", "--checked-by", "M. Weber"), "a person other than M. Weber"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    with Registry.open(tmp_path) as registry:
        calibrated_bench(registry)
    app = typer.Typer()
    app.command()(with_check(operation_command(find_operation("certificate"))))
    result = CliRunner().invoke(app, [*arguments, "--data", str(tmp_path)])
    assert isinstance(result.exception, TorquebenchError)
    assert said in str(result.exception)
    assert not (tmp_path / "certificates").exists()


def test_calibration_is_found_by_run_number_and_latest(tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        with pytest.raises(InputError, match="no calibration is registered"):
            find_calibration(registry, "latest")
        bench = calibrated_bench(registry)
        for name in ("latest", "calibration-1", bench.run_id, bench.run_id[:-3]):
            assert find_calibration(registry, name) == bench.calibration
        calibrated_bench(registry)
        with pytest.raises(InputError, match="several runs begin"):
            find_calibration(registry, bench.run_id[:8])
