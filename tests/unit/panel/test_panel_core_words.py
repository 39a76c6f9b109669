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
from torquebench.campaign.reducers.tests import TESTS
from torquebench.compensation import MODELS
from torquebench.panel.service import SIGNALS
from torquebench.panel.text.core import HOLE, WORDY, core_templates, translated
from torquebench.signals import SignalFaultKind

ROOT = Path(torquebench.__file__).parent
OPERATORS_ROOMS = (
    "bench/prompts.py",
    "bench/safety/stopping.py",
    "bench/safety/supervisor.py",
    "bench/safety/heartbeats.py",
    "bench/safety/signals.py",
    "bench/interlocks.py",
    "bench/auditing.py",
    "campaign/external_calibration.py",
    "campaign/finishing.py",
    "campaign/measuring.py",
    "campaign/registering.py",
    "campaign/resuming.py",
    "panel/run_in_process.py",
    "panel/service/access/actors.py",
    "panel/service/bench_service.py",
    "panel/service/access/login_throttle.py",
    "panel/service/jobs/calibrations.py",
    "panel/service/jobs/checks.py",
    "panel/service/jobs/runner.py",
    "panel/service/access/lease.py",
    "panel/service/access/passwords.py",
    "panel/service/access/people.py",
    "panel/service/jobs/previews.py",
    "panel/service/records/queries.py",
    "panel/service/live/hub.py",
    "panel/service/live/layout.py",
    "panel/service/live/markers.py",
    "panel/service/live/spans.py",
    "panel/pages/live_chart.py",
    "panel/service/settings/store.py",
    "panel/service/settings/documents.py",
    "panel/service/records/table_import.py",
    "procedures/rehearsal.py",
    "station/bench_station.py",
    "station/recording.py",
)
"""Where what an operator meets every day is said."""
FINDERS = (
    "reducers/breakaway/evaluation.py",
    "reducers/efficiencies/evaluation.py",
    "reducers/loops/evaluation.py",
    "reducers/loops/findings.py",
    "reducers/loops/ripple.py",
    "reducers/running/no_load.py",
    "reducers/running/no_load_points.py",
    "reducers/transmission/evaluation.py",
)
"""Where a reducer test says what it found odd."""
SAID_BY = re.compile(r"(Error|Fault|Violation|_violated|trip|ask|start)$")
NOT_SHOWN = (
    "7 names 7",  # put together: both of its forms are in the catalogue
    "the torque stops near ±7 N·m, 7",
    "7 to 7 °C during the test (allowed: a range of 7 K)7",
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


def sentences(path: str, said_by: re.Pattern[str] = SAID_BY) -> Iterator[str]:
    """Yield what a module raises, asks and reports."""
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and said_by.search(ast.unparse(node.func)):
            for value in (*node.args, *(keyword.value for keyword in node.keywords)):
                said = spoken(value)
                if said and WORDY.search(said) and not said.startswith(NOT_SHOWN):
                    yield said


def known(said: str) -> bool:
    return translated(said, "zh") != said


@pytest.mark.parametrize("path", OPERATORS_ROOMS)
def test_what_an_operator_meets_is_said_in_chinese(path: str) -> None:
    assert [said for said in sentences(path) if not known(said)] == []


@pytest.mark.parametrize("path", FINDERS)
def test_what_a_reducer_test_finds_odd_is_said_in_chinese(path: str) -> None:
    found = sentences(path, re.compile("Finding$"))
    assert [said for said in found if WORDY.search(translated(said, "zh"))] == []


@pytest.mark.parametrize(
    ("said", "chinese"),
    [
        (
            "few loops: 2 whole loops at one position; "
            "record at least three loops at each position",
            "回线太少：1 个位置上共 2 条完整回线；每个位置至少记录三条回线",
        ),
        (
            "standard, i = 80: 6 quantities found; 3 of 3 limits of the data sheet kept.",
            "标准型，i = 80：得到 6 个量；数据表的 3 项限值中 3 项满足。",
        ),
        (
            "efficiency at 400 N·m, 100 rpm, mean of both directions, output drives",
            "400 N·m、100 rpm 时的效率，两个方向的平均值，输出端驱动",
        ),
        ("Due within 60 days of 2026-11-23", "自 2026-11-23 起 60 天内到期"),
        ("Transducer T-1 over 2 benches", "传感器 T-1，2 个台架"),
        (
            "Span of 2 transducers of the kind T10F, 9 calibrations",
            "T10F 型传感器的量程：2 个传感器，9 次校准",
        ),
        ("Capability: backlash, arcmin, of RV-40E", "RV-40E 的过程能力：背隙，arcmin"),
        ("Control charts: backlash, arcmin, of RV-40E", "RV-40E 的控制图：背隙，arcmin"),
        ("Outliers: backlash, arcmin, of RV-40E", "RV-40E 的异常值：背隙，arcmin"),
        ("Benches by specimen S-1: backlash, arcmin", "按试件 S-1 比对台架：背隙，arcmin"),
        ("no heartbeat of the run engine for 2.3 s", "运行引擎已有 2.3 s 没有心跳"),
    ],
)
def test_a_sentence_put_together_is_taken_apart_where_it_was(said: str, chinese: str) -> None:
    assert translated(said, "zh") == chinese


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


PUT_TOGETHER = (
    "the torque stops near",
    "{low} to {high} °C during the test",
    "the torque that accelerates the output flange",
    "output positions: {count}, too few",
    "wait until command is given up",
    "{name} names no unfinished run",
    "{name} names several unfinished runs",
    "the {kind} run was aborted ({reason})",
    "input {a} N·m, output {b} N·m",
    "output {b} N·m, input {a} N·m",
    "{name}: {count} quantities found",
    "back-driving torque, {direction}",
    "viscous coefficient, {direction}",
    "Stribeck torque, {direction}",
    "speed {speed} 1/min, allowed",
    "temperature {temperature} °C, allowed",
    "without load the",
    "efficiency at {torque} N·m, {speed} rpm, ",
)
"""Beginnings of sentences that no line of the source holds whole."""


def test_every_known_sentence_is_still_said_somewhere() -> None:
    said = "\n".join(
        str(node.value)
        for file in ROOT.rglob("*.py")
        if "panel/text" not in file.as_posix()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    said += "".join(
        file.read_text(encoding="utf-8")
        for file in ROOT.rglob("*.toml")
        if "_zh" not in file.parent.name and "zh" not in file.stem
    )
    stale = [
        english
        for english in core_templates("zh")
        if not english.startswith(PUT_TOGETHER)
        and any(part.strip() not in said for part in HOLE.split(english)[::2] if WORDY.search(part))
    ]
    assert stale == []


def test_key_points_of_a_loop_are_named_in_chinese() -> None:
    for end in ("lower", "upper"):
        assert not WORDY.search(translated(f"stiffness, {end} end", "zh"))
