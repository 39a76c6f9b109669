"""Model files: bit for bit back, guarded against edits, tied to transducer, counter and range."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from torquebench.compensation import (
    MODELS,
    CompensationModel,
    OutlierWarning,
    PolynomialModel,
    Provenance,
    StoredModel,
    features,
    load_model,
    make_model,
    model_from_state,
    save_model,
)
from torquebench.compensation.kinds import NETWORKS
from torquebench.compensation.state import decode_value, encode_value
from torquebench.errors import InputError, ModelMismatchError, RecordError

QuickModel = Callable[..., CompensationModel]
KINDS = sorted({*MODELS, *NETWORKS} - {"network"})
PROVENANCE = Provenance(
    range_nm=2000.0,
    side="output",
    transducer_serial="T40B-0042",
    counter_identity="simulated 100 MHz",
    training_data_sha256="00" * 32,
    metrics={"worst_nm": 1.5, "rms_nm": 0.1 + 0.2},
    software_version="0.1.0",
    created="2024-05-01T10:00:00+02:00",
)


def chain(seed: int, count: int = 26) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    reading = np.linspace(-1000.0, 1000.0, count) + generator.normal(0.0, 3.0, count)
    X = features(reading, branch=generator.choice([-1, 1], count), series=0)
    additional = generator.normal(0.0, 1.0, 3) @ [1e-2, 1e-3, 1e-6] * reading
    return X, reading + additional + generator.normal(0.0, 0.3, count)


@pytest.mark.parametrize("kind", KINDS)
@settings(
    max_examples=1,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(seed=st.integers(0, 2**31))
def test_every_model_comes_back_bit_for_bit(
    quick_model: QuickModel, tmp_path: Path, kind: str, seed: int
) -> None:
    X, y = chain(seed)
    model = quick_model(kind, range_nm=1100.0).fit(X, y)
    stored = StoredModel(model, PROVENANCE)
    again = load_model(save_model(tmp_path / "model.json", stored))
    assert type(again.model) is type(model)
    assert again.provenance == PROVENANCE
    assert again.model.kind_parameters == model.kind_parameters
    at = features(np.linspace(X[:, 0].min(), X[:, 0].max(), 40), branch=1, series=0)
    np.testing.assert_array_equal(
        again.model.predict(at, return_std=True), model.predict(at, return_std=True)
    )
    assert again.model.noise_nm_ == model.noise_nm_


@pytest.fixture
def path(tmp_path: Path) -> Path:
    X, y = chain(0)
    return save_model(tmp_path / "m.json", StoredModel(PolynomialModel().fit(X, y), PROVENANCE))


def edited(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["provenance"].update(transducer_serial="another"),
        lambda d: d["provenance"]["metrics"]["dict"].update(worst_nm=0.1),
        lambda d: d["model"]["parameters"].update(degree=3),
        lambda d: d["model"]["fitted"].update(noise_nm_=0.0),
        lambda d: d.update(checksum="0" * 64),
        lambda d: d.pop("checksum"),
        lambda d: d.update(note="checked"),
    ],
)
def test_an_edited_file_is_noticed(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    with pytest.raises(InputError, match="changed after it was written"):
        load_model(edited(path, change))


def test_layout_and_order_of_keys_are_free(path: Path) -> None:
    document = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(document.items())), indent=7))
    assert load_model(path).provenance == PROVENANCE


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "isn't a model file"),
        ("[1, 2]", "isn't a model file"),
        ('{"format": "other"}', "isn't a model file"),
        ('{"format": "torquebench-model", "format_version": 99}', "version 99"),
        ("\x80", "isn't a model file"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "other.json"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=message):
        load_model(path)


def test_a_missing_file_and_a_missing_folder_are_named(tmp_path: Path, path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.json"):
        load_model(tmp_path / "nowhere.json")
    with pytest.raises(InputError, match="can't write"):
        save_model(tmp_path / "nowhere" / "model.json", load_model(path))


def test_an_unknown_kind_is_named_with_the_known_ones(path: Path) -> None:
    state = load_model(path).model.get_state()
    with pytest.raises(InputError, match=r"'oracle'.*polynomial"):
        model_from_state({**state, "kind": "oracle"})
    with pytest.raises(InputError, match="can't be rebuilt"):
        model_from_state({"kind": "polynomial", "parameters": {"colour": 1}})


def test_an_old_file_stays_whole_when_writing_fails(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, stored = path.read_bytes(), load_model(path)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RecordError, match="No space left"):
        save_model(path, replace(stored, provenance=replace(PROVENANCE, side="input")))
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_model_fits_only_what_it_was_made_with(path: Path) -> None:
    stored = load_model(path)
    stored.check_fits()
    stored.check_fits("T40B-0042", "simulated 100 MHz", 2000.0)
    stored.check_fits(range_nm=1000.0)
    for arguments, message in (
        ({"transducer_serial": "T40B-0007"}, r"transducer 'T40B-0042'.*'T40B-0007'"),
        ({"counter_identity": "NI 6612"}, "counter"),
        ({"range_nm": 3000.0}, "calibrated to 2000"),
    ):
        with pytest.raises(ModelMismatchError, match=message):
            stored.check_fits(**arguments)
    unknown = replace(stored, provenance=replace(PROVENANCE, transducer_serial=""))
    with pytest.raises(ModelMismatchError, match="unknown"):
        unknown.check_fits(transducer_serial="T40B-0007")


def test_outliers_stay_on_record(tmp_path: Path) -> None:
    X, y = chain(1)
    y[5] += 100.0
    with pytest.warns(OutlierWarning):
        model = PolynomialModel().fit(X, y)
    again = load_model(save_model(tmp_path / "m.json", StoredModel(model, PROVENANCE)))
    assert again.model.outliers_ == model.outliers_
    assert again.model.outliers_[0].row == 5


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**62), 2**62)
    | st.floats(allow_nan=False)
    | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=12,
)


@given(value=json_values)
def test_values_come_back_through_json_without_loss(value: object) -> None:
    assert decode_value(json.loads(json.dumps(encode_value(value), allow_nan=False))) == value


@given(
    values=st.lists(st.floats(width=64), max_size=6),
    dtype=st.sampled_from(["float64", "int8", "bool"]),
)
def test_arrays_keep_type_shape_and_bits(values: list[float], dtype: str) -> None:
    array = np.nan_to_num(np.array(values), posinf=1.0, neginf=-1.0).clip(-100, 100).astype(dtype)
    if dtype == "float64":
        array = np.array(values)
    array = array.reshape(-1, 1)
    again = decode_value(json.loads(json.dumps(encode_value(array), allow_nan=False)))
    assert again.dtype == array.dtype
    np.testing.assert_array_equal(again, array)


def test_what_a_model_file_cannot_hold_is_a_defect_not_a_surprise() -> None:
    for value in (object(), np.array(["a"]), {1, 2}):
        with pytest.raises(TypeError):
            encode_value(value)
    with pytest.raises(InputError, match="keys"):
        decode_value({"what": 1})


WRITTEN_BY_0_2_0 = json.loads((Path(__file__).parent / "models_0_2_0.json").read_text())
"""Model files that version 0.2.0 wrote, with its values at some readings as hexadecimal floats."""


@pytest.mark.parametrize("kind", sorted(WRITTEN_BY_0_2_0["files"]))
def test_a_file_of_0_2_0_gives_the_same_bits(kind: str, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(WRITTEN_BY_0_2_0["files"][kind]))
    stored = load_model(tmp_path / "m.json")
    again = load_model(save_model(tmp_path / "again.json", stored))
    reading = [float.fromhex(value) for value in WRITTEN_BY_0_2_0["reading_nm"]]
    for model in (stored.model, again.model):
        found = model.predict(features(reading), return_std=True)
        expected = WRITTEN_BY_0_2_0["values"][kind]
        for values, wanted in zip(found, expected, strict=True):
            assert [float(value).hex() for value in values] == wanted
    assert stored.model.name in (kind, "polynomial-3")
    assert np.isfinite(stored.model.scatter_nm)


@pytest.mark.parametrize("kind", ["physics", "gaussian-process", "spline", "hybrid"])
def test_a_model_of_0_2_0_whose_kind_is_gone_is_refused_with_what_to_do(kind: str) -> None:
    fitted = {"dictionary_": {}, "uncertainty_": {}} if kind == "hybrid" else {}
    state = {"kind": kind, "parameters": {}, "fitted": fitted}
    with pytest.raises(
        ModelMismatchError, match=rf"{kind}.*0\.2\.0.*fit the same calibration again"
    ):
        model_from_state(state)


def test_a_discrepancy_of_0_2_0_has_one_scatter_for_all_torques() -> None:
    reading = np.linspace(-100.0, 100.0, 30)
    model = make_model("polynomial").fit(features(reading), reading + 1e-5 * reading**2)
    state = json.loads(json.dumps(model.get_state()))
    state["discrepancy"] = state["fitted"].pop("uncertainty_")
    state["discrepancy"]["content"]["scatter"] = 2.5e-4
    again = model_from_state(state)
    np.testing.assert_array_equal(again.scatter_at(reading), 100.0 * 2.5e-4)
    assert again.scatter_nm == 100.0 * 2.5e-4
