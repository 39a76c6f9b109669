"""The log and the columns of a run are said in words, in both languages."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

import torquebench.panel.service
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.pages.settings.log import details_said
from torquebench.panel.service.bench_service import JOB_KINDS
from torquebench.panel.text import LANGUAGES, Text, words
from torquebench.panel.text.core import translated
from torquebench.records.tables.column_words import column_unit

SERVICE = Path(torquebench.panel.service.__file__).parent
NOTED = re.compile(r'(?:\b|_)note\(\s*(?:connection,\s*)?[\w.\[\]:]+,\s*f?"([^"]+)"')
SAMPLES = (
    *(f"{side}_{what}" for side in ("input", "output") for what in (
        "torque_hz", "torque_nm", "torque_fault", "reference_hz", "reference_nm",
        "reference_fault", "angle_counts", "speed_rad_s", "compensated_nm",
        "torque_uncertainty_nm")),
    "ambient_c", "input_transducer_c", "output_transducer_c", "reducer_c", "calibrator_c",
)  # fmt: skip
POINTS = (
    "time_s", "reading_nm", "reading_standard_error_nm", "reading_drift_nm_per_s", "frequency_hz",
    "settled", "samples", "commanded_nm", "speed_rpm", "temperature_c", "torque_nm",
    "torque_uncertainty_nm", "standard_nm", "standard_uncertainty_nm", "standard_drift_nm_per_s",
    "standard_frequency_hz", "true_torque_nm", "series", "step", "branch", "target_nm",
    "position_deg", "group", "error_nm", "start_s", "stop_s",
)  # fmt: skip


def _fields(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        parts = [
            each
            for each in (field.annotation, *getattr(field.annotation, "__args__", ()))
            if isinstance(each, type) and issubclass(each, BaseModel)
        ]
        if parts:
            yield from _fields(parts[0])
        else:
            yield name


def test_every_action_of_the_log_is_said_in_chinese() -> None:
    actions = {
        said for file in SERVICE.rglob("*.py") for said in NOTED.findall(file.read_text("utf-8"))
    }
    assert {"signed in", "started a job", "put a marker"} <= actions
    assert [said for said in sorted(actions) if translated(said, "zh") == said] == []


@pytest.mark.parametrize("kind", JOB_KINDS)
def test_what_a_job_was_asked_is_labelled(kind: str) -> None:
    labels = words("zh")
    assert f"job.{kind}" in labels
    missing = [
        name for name in _fields(JOB_KINDS[kind].request) if f"log_detail.{name}" not in labels
    ]
    assert missing == []


def test_details_leave_out_what_nobody_filled_in() -> None:
    request = {"mounting": {"coaxiality_mm": None, "by": ""}, "step_percent": 20.0,
               "models": ["hybrid"], "bench_clear": False}  # fmt: skip
    details = {"job_id": "7ed3", "kind": "calibrate", "request": request}
    assert details_said(Text("en"), details) == (
        "job: 7ed3; kind: Calibration; step, % of range: 20; models: physics + Gaussian process"
    )
    assert details_said(Text("zh"), {"accepted": False, "state": "done"}) == "接受: 否; 状态: 完成"
    assert details_said(Text("zh"), {"address": "test"}) == "地址: test"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_column_of_a_run_has_a_title(language: str) -> None:
    text = Text(language)
    named = [name for name in SAMPLES if column_title(text, name, samples=True) == name]
    named += [name for name in POINTS if column_title(text, name) == name]
    assert named == []
    assert all(column_unit(name)[0] for name in (*SAMPLES, *POINTS))
