"""Every command takes `--quiet`, and those that answer with data take `--json`."""

from typing import Any

import pytest
import typer

from torquebench.cli import COMMANDS, whole_command
from torquebench.cli.failure import guarded
from torquebench.cli.output_options import HELP_OPTIONS, RESULTS, WITHOUT_RESULT
from torquebench.cli.terminal.console import (
    answer,
    begin_output,
    leave_standard_output,
    note,
    say,
    warn,
)
from torquebench.errors import InputError
from torquebench.operations import OPERATIONS, json_schemas


def commands(group: Any = None, path: str = "") -> dict[str, set[str]]:
    """Return each command with its options."""
    found: dict[str, set[str]] = {}
    for name, child in getattr(group or whole_command(), "commands", {}).items():
        if hasattr(child, "commands"):
            found |= commands(child, f"{path}{name} ")
        else:
            found[path + name] = {option for each in child.params for option in each.opts}
    return found


@pytest.fixture(autouse=True)
def _reset():
    yield
    begin_output("", json=False, quiet=False)


def test_every_command_answers_in_json_or_is_named_with_the_reason() -> None:
    found = commands()
    own = {name for name in found if name not in OPERATIONS or COMMANDS.get(name)}
    assert own == set(RESULTS) | set(WITHOUT_RESULT)
    assert not set(RESULTS) & set(WITHOUT_RESULT)
    for name, options in found.items():
        assert ("--json" in options) == (name not in WITHOUT_RESULT), name


def test_every_result_of_a_command_has_a_schema() -> None:
    whole_command()
    for name, kind in RESULTS.items():
        _, parts = json_schemas([kind])
        assert parts[kind.__name__].get("description"), name


def test_every_command_can_be_quiet() -> None:
    assert [name for name, options in commands().items() if not {"--quiet", "-q"} <= options] == []


def test_help_shows_no_type_beside_a_flag() -> None:
    def helps(command: Any) -> list[str]:
        shown = [
            (max(each.opts, key=len), each.display_type_rich(context))
            for context in [typer.Context(command, help_option_names=HELP_OPTIONS)]
            for each in command.get_params(context)
        ]
        below = getattr(command, "commands", {}).values()
        return [f"{command.name} {name}" for name, kind in shown if "bool" in str(kind)] + [
            found for child in below for found in helps(child)
        ]

    assert helps(whole_command()) == []


def test_completion_can_be_installed_and_shown() -> None:
    options = {option for each in whole_command().params for option in each.opts}
    assert {"--install-completion", "--show-completion", "--version"} <= options


def test_quiet_leaves_warnings_and_errors(capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> None:
        begin_output("fit", json=False, quiet=True)
        say("a result")
        note("a note")
        warn("a warning")
        raise InputError("an error")

    assert guarded(run, debug=lambda: False) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "a result" not in said.err
    assert "a note" not in said.err
    assert "a warning" in said.err
    assert "an error" in said.err


def test_json_replaces_the_tables_and_carries_warnings_and_the_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    import json

    def run() -> None:
        begin_output("fit", json=True, quiet=False)
        say("a result")
        answer(points=3, files=["a.json"])
        answer(files=["b.html"])
        warn("a warning")
        raise InputError("what was found", "what is allowed", "what to do")

    assert guarded(run, debug=lambda: False) == 2
    written = json.loads(capsys.readouterr().out)
    assert written.pop("torquebench")
    assert written == {
        "command": "fit",
        "exit_code": 2,
        "answer": {"points": 3, "files": ["a.json", "b.html"]},
        "warnings": ["a warning"],
        "error": {
            "found": "what was found",
            "allowed": "what is allowed",
            "do": "what to do",
        },
    }


@pytest.mark.parametrize("setting", ["json", "quiet"])
def test_a_commands_settings_end_with_it(setting: str, capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> None:
        begin_output("fit", **{"json": False, "quiet": False} | {setting: True})
        answer(points=3)

    assert guarded(run, debug=lambda: False) == 0
    capsys.readouterr()
    say("a result")
    assert guarded(lambda: 0, debug=lambda: False) == 0
    assert capsys.readouterr().out == "a result\n"


def test_a_file_and_json_cannot_share_standard_output() -> None:
    begin_output("fit", json=True, quiet=False)
    with pytest.raises(InputError, match="standard output"):
        leave_standard_output()


def test_help_shows_two_values_of_a_pair(capsys: pytest.CaptureFixture[str]) -> None:
    command = whole_command()
    with pytest.raises(SystemExit):
        command(args=["evaluate", "hysteresis", "--help"], prog_name="torquebench")
    said = capsys.readouterr().out
    assert "bool" not in said
    assert "<float> <float>" in " ".join(said.split())
