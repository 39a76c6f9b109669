"""What a calibration has found is read from its records, also after a restart of the panel."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.system.panel.test_panel_jobs import BEN, ended, opened

from torquebench.errors import RecordError
from torquebench.records.files import plain_json


def written(value: Any) -> str:
    return json.dumps(plain_json(value))


def test_a_restarted_panel_states_what_a_calibration_and_its_verification_found(
    tmp_path: Path,
) -> None:
    with opened(tmp_path) as service:
        request = {"side": "output", "step_percent": 25.0, "models": ["polynomial-2"]}
        measured = ended(service, service.jobs.start(BEN, "calibrate", request))
        assert measured.state == "done", measured.problem
        assert service.records.interrupted() is None
        assert service.records.verified(1) is None
        fresh = {"side": "output", "calibration": 1, "groups": 1, "points": 8}
        verified = ended(service, service.jobs.start(BEN, "verification", fresh))
        assert verified.state == "done", verified.problem
    with opened(tmp_path) as service:
        assert written(service.records.module(1)) == written(measured.result.modules[0])
        assert written(service.records.verified(1)) == written(verified.result)
        with pytest.raises(RecordError):
            service.records.module(7)
        of_another_version = tmp_path / "of-another-version.json"
        of_another_version.write_text("{}")
        registry = service.station.registry
        model = registry.add_model(
            registry.calibration(1), kind="hybrid", file=of_another_version, side="output"
        )
        registry.activate(model.model_id)
    with opened(tmp_path) as service:
        output = service.snapshot().sides["output"]
        assert output.compensation is None
        assert "of-another-version.json" in output.compensation_problem
