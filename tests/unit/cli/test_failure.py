"""Errors become one message and an exit code."""

import pytest

from torquebench.cli.failure import CHECK_FAILED, INTERRUPTED, OK, UNUSABLE_INPUT, guarded
from torquebench.errors import (
    BenchError,
    InputError,
    InterlockError,
    LimitError,
    ModelMismatchError,
    RecordError,
    SignalFault,
    TorquebenchError,
)


def raising(error: BaseException):
    def run() -> int:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("an empty table"), UNUSABLE_INPUT),
        (ModelMismatchError("a model of another transducer"), UNUSABLE_INPUT),
        (FileNotFoundError(2, "No such file or directory", "x.csv"), UNUSABLE_INPUT),
        (SignalFault("no pulses"), CHECK_FAILED),
        (BenchError("no answer"), CHECK_FAILED),
        (LimitError("2500 N·m"), CHECK_FAILED),
        (InterlockError("clamp open"), CHECK_FAILED),
        (RecordError("a changed file"), CHECK_FAILED),
        (ZeroDivisionError("a bug"), CHECK_FAILED),
        (KeyboardInterrupt(), INTERRUPTED),
    ],
)
def test_exit_codes(error: BaseException, code: int) -> None:
    assert guarded(raising(error), debug=lambda: False) == code


def test_success_is_zero() -> None:
    assert guarded(lambda: None, debug=lambda: False) == OK
    assert guarded(lambda: 7, debug=lambda: False) == 7


def test_a_message_says_found_allowed_and_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    error = TorquebenchError("range 0 N·m", "a range above 0 N·m", "give --range 2000")
    guarded(raising(error), debug=lambda: False)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "error    range 0 N·m" in shown.err
    assert "allowed  a range above 0 N·m" in shown.err
    assert "do       give --range 2000" in shown.err
    assert "Traceback" not in shown.err


def test_brackets_of_a_message_are_not_markup(capsys: pytest.CaptureFixture[str]) -> None:
    guarded(raising(InputError("section [driver] and [/bold]")), debug=lambda: False)
    assert "section [driver] and [/bold]" in capsys.readouterr().err


def test_long_messages_fold_at_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    guarded(raising(InputError("word " * 60, "x" * 200)), debug=lambda: False)
    assert max(len(line) for line in capsys.readouterr().err.splitlines()) <= 80


def test_debug_lets_the_traceback_through() -> None:
    with pytest.raises(InputError):
        guarded(raising(InputError("an empty table")), debug=lambda: True)


def test_an_unforeseen_error_names_itself_and_the_way_to_more(
    capsys: pytest.CaptureFixture[str],
) -> None:
    guarded(raising(ZeroDivisionError("division by zero")), debug=lambda: False)
    shown = capsys.readouterr().err
    assert "ZeroDivisionError" in shown
    assert "--debug" in shown
