"""Runs that a kill has left behind: named on the panel, finished or discarded as jobs."""

from pathlib import Path

import pytest
from tests.support.draws import nightly
from tests.system.interrupted_phases import stopped
from tests.system.panel.test_panel_jobs import ANA, BEN, ended, opened

from torquebench.errors import InputError
from torquebench.panel.service import PermissionDeniedError


@pytest.mark.parametrize("discarded", [False, nightly(True)])
def test_a_run_that_was_killed_before_its_registration_is_finished_or_discarded(
    tmp_path: Path, discarded: bool
) -> None:
    assert stopped("killed", "fit", tmp_path, 3, 0.0) == ""
    with opened(tmp_path) as service:
        (left,) = service.unfinished()
        assert left.state == "measured"
        assert "its calibration isn't registered" in left.found
        request = {"run_id": left.run_id}
        if discarded:
            asked = {**request, "reason": "the clamp was loose"}
            with pytest.raises(PermissionDeniedError):
                service.jobs.start(BEN, "records-discard", asked)
            view = ended(service, service.jobs.start(ANA, "records-discard", asked))
            assert view.state == "done", view.problem
            assert service.records.calibrations() == []
        else:
            view = ended(service, service.jobs.start(BEN, "records-finish", request))
            assert view.state == "done", view.problem
            assert view.result is not None
            (module,) = view.result.modules
            assert module.calibration_id == 1
            assert len(module.points.reading_nm) == 16
        assert service.unfinished() == []
        assert service.records.runs().total == 1, "nothing was measured"
        who = ANA if discarded else BEN
        with pytest.raises(InputError, match="no unfinished run"):
            service.jobs.start(who, "records-finish", request)
