import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from torquebench.bench.description import default_bench
from torquebench.errors import InputError
from torquebench.panel.pages.settings.labels import CHOICES
from torquebench.panel.pages.settings.names import group_title, setting_title
from torquebench.panel.service import (
    Actor,
    BusyError,
    PermissionDeniedError,
    read_upload,
)
from torquebench.panel.service.settings.differences import flat, nested
from torquebench.panel.service.settings.documents import (
    BENCH,
    LARGEST_UPLOAD,
    SECTIONS,
    builtin_names,
    load_builtin,
)
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.panel.service.store import PanelStore
from torquebench.panel.text import Text
from torquebench.panel.text.catalogue import Language
from torquebench.units import unit_of_name

ADA = Actor("Ada", "administrator", "1")
BEN = Actor("Ben", "metrologist", "2")
LIMIT = {"output": {"limits": {"torque_nm": 2200.0}}}
KEYS = st.text("abc", min_size=1, max_size=3)


@pytest.fixture
def settings(tmp_path: Path) -> Iterator[SettingsStore]:
    store = PanelStore(tmp_path)
    yield SettingsStore(store, default_bench())
    store.close()


@given(
    st.recursive(
        st.integers(), lambda inner: st.dictionaries(KEYS, inner, min_size=1), max_leaves=8
    ).filter(lambda value: isinstance(value, dict))
)
def test_flat_documents_become_what_they_were(document: dict[str, object]) -> None:
    assert nested(flat(document)) == document


def test_a_change_is_validated_shown_logged_and_undone(settings: SettingsStore) -> None:
    before = settings.bench()
    shown = settings.preview("bench", "bench", LIMIT)
    assert [(each.key, each.before, each.after) for each in shown.differences] == [
        ("output.limits.torque_nm", 2400.0, 2200.0)
    ]
    assert settings.bench() == before
    made = settings.change(ADA, "bench", "bench", LIMIT, reason="a weaker coupling")
    assert settings.bench().output.limits.torque_nm == 2200.0
    assert made.differences == shown.differences
    undone = settings.undo(ADA, made.number)
    assert settings.bench() == before
    newest, first = settings.history("bench")
    assert (newest.undoes, first.undone_by) == (first.number, newest.number)
    assert (first.who, first.reason) == ("Ada", "a weaker coupling")
    assert undone.number == newest.number


def test_an_undo_leaves_later_changes_of_other_keys_alone(settings: SettingsStore) -> None:
    first = settings.change(ADA, "bench", "bench", LIMIT)
    settings.change(ADA, "bench", "bench", {"input": {"limits": {"speed_rpm": 900.0}}})
    settings.undo(ADA, first.number)
    bench = settings.bench()
    assert (bench.output.limits.torque_nm, bench.input.limits.speed_rpm) == (2400.0, 900.0)


def test_a_key_that_was_changed_again_is_not_undone(settings: SettingsStore) -> None:
    first = settings.change(ADA, "bench", "bench", LIMIT)
    settings.change(ADA, "bench", "bench", {"output": {"limits": {"torque_nm": 2300.0}}})
    with pytest.raises(BusyError, match="changed again"):
        settings.undo(ADA, first.number)


@pytest.mark.parametrize(
    "document",
    [
        {"output": {"limits": {"torque_nm": -1}}},
        {"output": {"limits": {"torque_nm": float("nan")}}},
        {"output": {"limit": 3}},
        {"bench": {"driver": "other"}},
        {"driver": {"seed": 2}},
        {"calibrator": {"certificate": "/etc/passwd"}},
        {"input": {"transducer": {"serial": "SIM-T2000"}}},
    ],
)
def test_a_wrong_or_forbidden_value_changes_nothing(
    settings: SettingsStore, document: dict[str, object]
) -> None:
    with pytest.raises(InputError):
        settings.change(ADA, "bench", "bench", document)
    assert settings.history() == []


def test_changes_outlive_the_process_and_only_what_differs_is_kept(
    settings: SettingsStore, tmp_path: Path
) -> None:
    settings.change(ADA, "bench", "bench", LIMIT)
    description = default_bench()
    faster = description.input.limits.model_copy(update={"speed_rpm": 1100.0})
    changed = description.model_copy(
        update={"input": description.input.model_copy(update={"limits": faster})}
    )
    store = PanelStore(tmp_path)
    bench = SettingsStore(store, changed).bench()
    store.close()
    assert (bench.output.limits.torque_nm, bench.input.limits.speed_rpm) == (2200.0, 1100.0)


def test_a_file_that_contradicts_the_panels_changes_is_refused(
    settings: SettingsStore, tmp_path: Path
) -> None:
    settings.change(ADA, "bench", "bench", {"output": {"range_nm": 1500.0}})
    description = default_bench()
    low = description.output.limits.model_copy(update={"torque_nm": 1000.0})
    output = description.output.model_copy(update={"limits": low, "range_nm": 900.0})
    store = PanelStore(tmp_path)
    with pytest.raises(InputError, match="panel's changes"):
        SettingsStore(store, description.model_copy(update={"output": output})).bench()
    store.close()


def test_own_profiles_are_added_changed_and_deleted(settings: SettingsStore) -> None:
    document = {**settings.get("profiles", "check").document, "name": "slow-check"}
    settings.change(BEN, "profiles", "slow-check", document)
    assert settings.profile("slow-check").name == "slow-check"
    made = settings.change(BEN, "profiles", "slow-check", None, reason="unused")
    with pytest.raises(InputError):
        settings.profile("slow-check")
    settings.undo(BEN, made.number)
    assert settings.profile("slow-check") is not None
    with pytest.raises(InputError, match="is part of the software"):
        settings.change(BEN, "profiles", "check", document)


def test_a_shipped_reducer_is_taken_unchanged_under_an_own_name(settings: SettingsStore) -> None:
    shipped = resources.files("torquebench.reducers") / "types" / "rv-40e.toml"
    settings.change(BEN, "reducers", "rv-41e", read_upload(shipped.read_bytes()))
    assert settings.reducer("rv-41e") == settings.reducer("rv-40e")
    profile = dict(settings.get("profiles", "check").document)
    with pytest.raises(InputError, match="name"):  # of a profile it is the only name
        settings.change(BEN, "profiles", "other", profile)


@pytest.mark.parametrize("name", ["../../etc/passwd", "/tmp/x.toml", "a/b", "", "x" * 65])
def test_no_name_is_a_path(settings: SettingsStore, name: str) -> None:
    with pytest.raises(InputError):
        settings.profile(name)
    with pytest.raises(InputError):
        settings.reducer(name)
    with pytest.raises(InputError):
        settings.change(BEN, "profiles", name, dict(settings.get("profiles", "check").document))


def test_roles_and_versions_are_minded(settings: SettingsStore) -> None:
    with pytest.raises(PermissionDeniedError):
        settings.change(BEN, "bench", "bench", LIMIT)
    settings.change(ADA, "bench", "bench", LIMIT, version=0)
    with pytest.raises(BusyError, match="since then"):
        settings.change(ADA, "bench", "bench", {"bench": {"name": "another"}}, version=0)


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"a = ", b"x = 1\n" * LARGEST_UPLOAD], ids=["bytes", "toml", "size"]
)
def test_an_unusable_upload_is_refused(content: bytes) -> None:
    with pytest.raises(InputError):
        read_upload(content)


def test_a_value_that_was_unset_is_unset_again(settings: SettingsStore) -> None:
    before = settings.bench()
    assert before.input.limits.angle_deg is None
    made = settings.change(ADA, "bench", "bench", {"input": {"limits": {"angle_deg": 90.0}}})
    assert settings.bench().input.limits.angle_deg == 90.0
    settings.undo(ADA, made.number)
    assert settings.bench() == before


def test_an_undo_is_undone_like_any_change(settings: SettingsStore) -> None:
    made = settings.change(ADA, "bench", "bench", LIMIT)
    undone = settings.undo(ADA, made.number)
    again = settings.undo(ADA, undone.number)
    assert settings.bench().output.limits.torque_nm == 2200.0
    assert again.undoes == undone.number
    with pytest.raises(BusyError):
        settings.undo(ADA, undone.number)


def test_of_many_editors_at_once_nobody_overwrites_what_he_has_not_seen(
    settings: SettingsStore,
) -> None:
    limits = [2001.0 + number for number in range(12)]

    def change(limit: float) -> bool:
        try:
            settings.change(ADA, "bench", "bench", {"output": {"limits": {"torque_nm": limit}}})
        except BusyError:
            return False
        return True

    with ThreadPoolExecutor(len(limits)) as crowd:
        made = list(crowd.map(change, limits))
    changes = settings.history("bench")[::-1]
    assert len(changes) == sum(made) >= 1
    seen = 2400.0
    for each in changes:
        (found,) = each.differences
        assert found.before == seen
        seen = found.after
    assert settings.bench().output.limits.torque_nm == seen


def _deep(levels: int) -> dict[str, object]:
    found: dict[str, object] = {}
    for _ in range(levels):
        found = {"a": found}
    return found


@pytest.mark.parametrize("section", ["bench", "profiles"])
@pytest.mark.parametrize(
    "document",
    [
        {"output": {"limits": {"torque_nm": {"a": 1}}}},
        {"output": {"limits": 5}},
        {"output": None},
        {"output.limits.torque_nm": 2200.0},
        {"": {"": 1}},
        _deep(100_000),
        {"output": [[[[]]]] * 3},
    ],
    ids=range(7),
)
def test_a_document_of_another_shape_is_refused(
    settings: SettingsStore, section: str, document: dict[str, object]
) -> None:
    name = "bench" if section == "bench" else "own"
    with pytest.raises(InputError):
        settings.change(ADA, section, name, document)
    assert settings.history() == []


def test_who_may_change_nothing_learns_nothing_of_changes(settings: SettingsStore) -> None:
    with pytest.raises(PermissionDeniedError):
        settings.undo(Actor("Olga", "operator", "3"), 999)


def labelled() -> Iterator[tuple[str, str]]:
    """Every section and key that an editor may show."""
    for name, section in SECTIONS.items():
        documents: list[BaseModel] = [default_bench()]
        if name != BENCH:
            documents = [load_builtin(section.name, each) for each in builtin_names(section.name)]
        for key in {key for each in documents for key in flat(each.model_dump(mode="json"))}:
            yield name, key


@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_setting_has_a_plain_label_and_range(
    settings: SettingsStore, language: Language
) -> None:
    text = Text(language)
    for section, key in labelled():
        label, unit = setting_title(text, key), unit_of_name(key)
        assert "_" not in label, (section, key)
        hint = text(settings.allowed(section, key, unit))
        assert not re.search(r"\de[+-]?\d|_|'", hint), (section, key, hint)
        assert not (unit and hint) or not hint[-1].isdecimal(), (section, key, hint)
        if language == "zh":
            words = [hint.replace(unit, ""), label, group_title(text, key.rpartition(".")[0])]
            assert not any(re.search("[a-z]{3,}", each) for each in words), (key, words)
        for choice in settings.choices(section, key):
            if not isinstance(choice, int):
                said = choice in CHOICES
                assert said or section == "reducers", (key, choice)


def test_a_value_of_the_benchs_own_file_is_named_as_such(settings: SettingsStore) -> None:
    fixed = [key for section, key in labelled() if settings.fixed(section, key)]
    assert {"driver.seed", "bench.driver", "calibrator.certificate"} <= set(fixed)
    assert "conditions.temperature_low_c" not in fixed
    for key in fixed:
        with pytest.raises(InputError, match=r"can't be changed|is not a key|other"):
            settings.change(ADA, "bench", "bench", nested({key: "other"}))
