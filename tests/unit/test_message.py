"""Messages keep template and values wherever they go: errors, copies, processes, JSON, files."""

import copy
import json
import pickle
from pathlib import Path

import pytest

from torquebench.errors import InputError, LimitError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.service.jobs.job import Problem
from torquebench.panel.service.store import PanelStore
from torquebench.records import RunFolder
from torquebench.records.files import json_text, read_json, revived, with_messages
from torquebench.translations import translated

NESTED = Message(
    "{found}: {reason}", Message("{side} speed", "input"), Message("at most {limit:g} rpm", 50.0)
)


def same(found: str) -> bool:
    return (
        isinstance(found, Message)
        and (found, found.template, found.values) == (NESTED, NESTED.template, NESTED.values)
        and all(isinstance(each, Message) for each in found.values.values())
    )


def test_a_message_reads_as_its_text() -> None:
    assert NESTED == "input speed: at most 50 rpm"
    assert f"{NESTED}." == "input speed: at most 50 rpm."
    assert (NESTED.template, list(NESTED.values)) == ("{found}: {reason}", ["found", "reason"])


@pytest.mark.parametrize(
    "crossed",
    [
        pickle.loads(pickle.dumps(NESTED)),
        copy.deepcopy(NESTED),
        Message.restored(json.loads(json.dumps(NESTED.as_plain()))),
        pickle.loads(pickle.dumps(InputError(NESTED))).found,
        Message.of(ValueError(NESTED)),
        Message("{it}", NESTED).values["it"],
        Message("{it}", ValueError(NESTED)).values["it"],
        Problem.of(LimitError("", NESTED)).allowed,
    ],
)
def test_it_keeps_template_and_values_on_every_way(crossed: str) -> None:
    assert same(crossed)


def test_values_are_formatted_once_as_the_template_asks() -> None:
    said = Message("{a!r} of {b:.{digits}f} N·m, {{literal}}, {a!r}", "x", 1.234, 1)
    assert said == "'x' of 1.2 N·m, {literal}, 'x'"
    assert said.template == "{a} of {b} N·m, {{literal}}, {a}"
    assert Message.restored(said.as_plain()) == said


def test_a_value_with_braces_is_no_template() -> None:
    said = Message("file {name}", "{a}.csv")
    assert Message.restored(said.as_plain()) == said == "file {a}.csv"
    assert translated(Message("{place} is missing", "{a}.csv"), "zh") == "缺少 {a}.csv"


def test_a_missing_or_superfluous_value_is_refused() -> None:
    for values in ((), (1, 2)):
        with pytest.raises(ValueError, match="zip"):
            Message("{one} value", *values)


def test_joined_messages_keep_their_parts() -> None:
    joined = Message.joined((NESTED, "few loops"), "; ")
    found = Message.restored(json.loads(json.dumps(joined.as_plain())))
    assert found == joined == "input speed: at most 50 rpm; few loops"
    assert same(found.values["0"])


def test_an_error_says_found_allowed_and_remedy_as_one_message() -> None:
    said = Message.of(TorquebenchError(NESTED, "less", "slow down"))
    assert said == "input speed: at most 50 rpm; allowed: less; slow down"
    assert isinstance(said, Message)
    assert same(said.values["0"])


def test_a_file_keeps_its_messages_beside_its_content(tmp_path: Path) -> None:
    content = {"reason": NESTED, "list": [{"remark": NESTED}, "plain", 3]}
    file = tmp_path / "results.json"
    file.write_text(json_text(with_messages(content)), encoding="utf-8")
    kept = json.loads(file.read_text(encoding="utf-8"))
    assert kept["reason"] == str(NESTED)  # other programs read sentences
    found = revived(read_json(file))
    assert same(found["reason"])
    assert same(found["list"][0]["remark"])
    assert found == content


def test_content_without_messages_stays_as_it_is() -> None:
    assert with_messages({"a": "b"}) == {"a": "b"} == revived({"a": "b"})
    assert revived([1]) == [1]


def test_a_sealed_run_keeps_the_messages_of_its_results_and_of_its_end(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {"operator": "Ana"}, kind="calibrate-output")
    writer.write_results({"remarks": [NESTED]})
    folder = RunFolder.open(writer.seal("failed", NESTED).path)
    assert same(folder.results["remarks"][0])
    assert same(folder.manifest["reason"])
    folder.verify()


def test_the_panels_log_keeps_messages(tmp_path: Path) -> None:
    store = PanelStore(tmp_path)
    try:
        store.note("bench", NESTED)
        store.note("Ana", "signed in")
        signed, said = store.events()
        assert (signed.what, type(signed.what)) == ("signed in", str)
        assert same(said.what)
    finally:
        store.close()


def test_nothing_joined_stays_nothing_in_json() -> None:
    """The joint alone was read back."""
    assert Message.restored(Message.joined([]).as_plain()) == ""
