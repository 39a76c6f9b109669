"""What the core says in English is known on the Chinese panel, and nothing known is made up."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import torquebench
from torquebench.bench.safety import AlarmKind
from torquebench.calibration import load_profile
from torquebench.campaign.fitting import model_title
from torquebench.campaign.reducer_tests import TESTS
from torquebench.compensation import MODELS
from torquebench.panel.service import SIGNALS
from torquebench.panel.text.core import HOLE, WORDY, core_templates, translated
from torquebench.signals import SignalFaultKind

ROOT = Path(torquebench.__file__).parent
OPERATORS_ROOMS = (
    "bench/prompts.py",
    "bench/safety.py",
    "bench/safety_heartbeats.py",
    "bench/safety_signals.py",
    "bench/interlocks.py",
    "bench/auditing.py",
    "campaign/measured_elsewhere.py",
    "campaign/measuring.py",
    "campaign/resuming.py",
    "panel/aside.py",
    "panel/service/actors.py",
    "panel/service/bench_service.py",
    "panel/service/guard.py",
    "panel/service/job_calibrations.py",
    "panel/service/job_checks.py",
    "panel/service/jobs.py",
    "panel/service/lease.py",
    "panel/service/passwords.py",
    "panel/service/people.py",
    "panel/service/previews.py",
    "panel/service/records_desk.py",
    "panel/service/settings.py",
    "panel/service/settings_documents.py",
    "panel/service/table_desk.py",
    "procedures/rehearsal.py",
    "station/bench_station.py",
    "station/recording.py",
)
"""Where what an operator meets every day is said."""
SAID_BY = re.compile(r"(Error|Fault|Violation|_violated|trip|ask|start)$")
NOT_SHOWN = (
    "7 names 7",  # put together: both of its forms are in the catalogue
    "choose another with --data",
    "can't create the data directory",
    "a folder with write permission",
)


def spoken(node: ast.AST) -> str | None:
    """Return a sentence as it would come out, with sevens for its values."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "7" for part in node.values
        )
    return None


def sentences(path: str) -> Iterator[str]:
    """Yield what a module raises, asks and reports."""
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and SAID_BY.search(ast.unparse(node.func)):
            for value in (*node.args, *(keyword.value for keyword in node.keywords)):
                said = spoken(value)
                if said and WORDY.search(said) and not said.startswith(NOT_SHOWN):
                    yield said


def known(said: str) -> bool:
    return translated(said, "zh") != said


@pytest.mark.parametrize("path", OPERATORS_ROOMS)
def test_what_an_operator_meets_is_said_in_chinese(path: str) -> None:
    assert [said for said in sentences(path) if not known(said)] == []


def test_names_that_the_core_gives_are_said_in_chinese() -> None:
    named = [kind.value for kind in AlarmKind]
    named += [kind.description for kind in SignalFaultKind]
    named += [kind.remedy for kind in SignalFaultKind if kind.remedy]
    named += [model_title(kind) for kind in ({*MODELS} - {"polynomial"}) | {"polynomial-3", "raw"}]
    profiles = (ROOT / "calibration" / "profiles").glob("*.toml")
    named += [load_profile(file.stem).title for file in profiles]
    named += [test.title for test in TESTS.values()]
    named += [signal.title for signal in SIGNALS]
    assert [said for said in named if not known(said)] == []


def test_a_sentence_keeps_its_values_and_no_english() -> None:
    wrong = []
    for english, chinese in core_templates("zh").items():
        holes = set(HOLE.findall(english))
        names = re.compile(r"[a-z.-]*[_.][a-z._-]*|torquebench|series")
        rest = names.sub("", HOLE.sub("", chinese))
        if not set(HOLE.findall(chinese)) <= holes or WORDY.search(rest):
            wrong.append(chinese)
    assert wrong == []


def test_every_known_sentence_is_still_said_somewhere() -> None:
    said = "\n".join(
        str(node.value)
        for file in ROOT.rglob("*.py")
        if "panel/text" not in file.as_posix()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    said += "".join(file.read_text(encoding="utf-8") for file in ROOT.rglob("*.toml"))
    stale = [
        english
        for english in core_templates("zh")
        if any(part.strip() not in said for part in HOLE.split(english)[::2] if WORDY.search(part))
    ]
    assert stale == []
