import ast
from pathlib import Path

import pytest
from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS, OF_LIMITS, calibration

import torquebench.chain.effects
from torquebench.chain import (
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    Reference,
    Temperature,
    Zero,
)
from torquebench.compensation import make_model
from torquebench.reports.certificate.labels import LANGUAGES
from torquebench.translations import templates, translated


def has_words_everywhere(name: str) -> bool:
    return all(
        name in templates(language) and translated(name, language)
        for language in LANGUAGES
        if language != "en"
    )


def test_every_component_that_an_effect_names_has_words_on_certificates_and_in_the_panel() -> None:
    folder = Path(torquebench.chain.effects.__file__).parent
    names = {
        call.args[0].value
        for file in folder.glob("*.py")
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call)
        and ast.unparse(call.func) == "Component"
        and isinstance(call.args[0], ast.Constant)
    }
    names |= {*Reference.LIMITS.values()}
    assert {"dynamics", "noise in a window", "drift of standard"} <= names
    assert [name for name in names if not has_words_everywhere(name)] == []


@pytest.mark.parametrize("effects", [OF_LIMITS, EFFECTS_OF_ALL_KINDS], ids=["limits", "measured"])
def test_every_component_has_words_on_certificates_and_in_the_panel(effects: tuple) -> None:
    features, standard = calibration()
    model = make_model("hybrid", range_nm=2000.0).fit(features, standard)
    torque = MeasuringChain(model, effects).torque(Readings(features[:1, 0]))
    for component in torque.components:
        assert has_words_everywhere(component.name), component.name


def test_every_influence_that_is_not_in_u_has_words_on_certificates_and_in_the_panel() -> None:
    features, standard = calibration()
    model = make_model("polynomial-1", range_nm=2000.0).fit(features, standard)
    nothing = ((0.0, 0.0), (0.0, 0.0))
    chains = [
        MeasuringChain(model),
        MeasuringChain(model, (Zero("zeros", None), Temperature("probe", None, None))),
        MeasuringChain(
            model,
            (
                MeasuredTemperature("runs", 23.0, 10.0, 40.0, (10.0, 40.0), (0.0,) * 2, (0.0,) * 2),
                MeasuredRotation(
                    "runs", 23.0, -600.0, 600.0, 10.0, 40.0, (0.0, 600.0), (10.0, 40.0),
                    nothing, nothing, nothing, nothing,
                ),
            ),
        ),
    ]  # fmt: skip
    missing = {name for chain in chains for name in chain.missing()}
    assert {"zero drift", "temperature of span", "drag over load, span over speed"} <= missing
    for name in missing:
        assert has_words_everywhere(name), name
