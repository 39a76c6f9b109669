"""What the bench promises: 0.1 % FS for single readings, 0.06 % FS for the model alone."""

from pathlib import Path

import pytest
from tests.support.draws import nightly

from torquebench.bench.description import default_bench
from torquebench.calibration import load_profile
from torquebench.campaign.demo import DemoSettings, run_demo
from torquebench.station import Station


@pytest.mark.parametrize(("seed", "groups"), [nightly(2, 2), nightly(1, 10), nightly(3, 2)])
def test_both_modules_keep_the_promise(seed: int, groups: int, tmp_path: Path) -> None:
    description = default_bench()
    driver = {**description.driver, "seed": seed}
    description = description.model_copy(update={"driver": driver})
    fresh = load_profile("verification").with_options(groups=groups)
    settings = DemoSettings(verification=fresh, models=(), friction=None, seed=seed)
    with Station.open(description, tmp_path) as station:
        result = run_demo(station, settings)
    assert [module.side for module in result.modules] == ["input", "output"]
    for module in result.modules:
        assert len(module.calibration) == 200
        assert len(module.verification) == 50 * groups
        assert len(module.raw.verification.groups) == groups
        found = module.recommended
        assert found.verification.against_truth.worst_percent_fs < 0.1
        assert found.verification.against_standard.worst_percent_fs < 0.1
        assert found.dense.worst_percent_fs < 0.06
        assert module.raw.verification.against_truth.worst_percent_fs > 0.25
