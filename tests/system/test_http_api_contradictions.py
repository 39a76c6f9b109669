"""A model whose calibration contradicts itself comes into use over HTTP by a person's decision."""

from pathlib import Path

from tests.system.campaign.test_implausible_calibrations import KIND, Breaks, calibrate
from tests.system.panel_api import SLOW, administrator, person, program, serving

from torquebench.records import Registry
from torquebench.station import Station

pytestmark = SLOW
REASON = "the standard was read wrongly, seen on its display"


def test_a_person_may_decide_for_it_with_a_reason_on_the_record(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with Station.open(None, folder) as station:
        broken = Breaks(station, "input_reference", "wrong_span", 0.97, after=12)
        data, registered = calibrate(station, "input", broken)
    model = registered.models[KIND]
    assert model.contradictions
    path = "/operations/records-use"
    chosen = {"model": model.model_id}
    with serving(tmp_path, "--fast") as server, administrator(server) as admin:
        chief = person(server, admin, "Max", "metrologist")
        olga = person(server, admin, "Olga", "operator")
        plant = program(server, admin, "plant", "metrologist")
        despite = chosen | {"reason": REASON, "despite_contradictions": True}
        with chief, olga, plant:
            assert olga.post(path, json=despite).status_code == 403
            denied = plant.post(path, json=despite)
            assert denied.status_code == 403
            assert "a person's decision" in denied.text
            assert chief.post("/command", json={}).is_success
            refused = chief.post(path, json=chosen | {"reason": REASON})
            assert refused.is_client_error
            assert "contradicts itself" in refused.text
            unreasoned = chief.post(path, json=chosen | {"despite_contradictions": True})
            assert unreasoned.is_client_error
            assert "without a reason" in unreasoned.text
            assert chief.get("/bench").json()["sides"]["input"]["compensation"] is None
            assert chief.post(path, json=despite).status_code == 200
            used = chief.get("/bench").json()["sides"]["input"]["compensation"]
            assert used["model_id"] == model.model_id
    with Registry.open(folder) as registry:
        decision = registry.activations(data.transducer_serial)[-1]
    assert decision.operator.startswith("Max")
    assert "contradicts itself" in decision.reason
    assert REASON in decision.reason
