"""The log and the columns of a run are said in words, in both languages."""

import ast
import re
from pathlib import Path

import torquebench.panel.service
from torquebench.panel.pages.settings.log import details_said
from torquebench.panel.text import Text
from torquebench.translations import translated

SERVICE = Path(torquebench.panel.service.__file__).parent
NOTED = re.compile(r'(?:\b|_)note\(\s*(?:connection,\s*)?[\w.\[\]:]+,\s*f?"([^"]+)"')


def test_every_action_of_the_log_is_said_in_chinese() -> None:
    actions = {
        said for file in SERVICE.rglob("*.py") for said in NOTED.findall(file.read_text("utf-8"))
    }
    assert {"signed in", "started a job", "put a marker"} <= actions
    assert [said for said in sorted(actions) if translated(said, "zh") == said] == []


def test_every_detail_of_the_log_is_labelled_in_chinese() -> None:
    keys = {
        keyword.arg
        for file in SERVICE.rglob("*.py")
        for call in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(call, ast.Call) and ast.unparse(call.func).rpartition(".")[2].endswith("note")
        for keyword in call.keywords
        if keyword.arg not in (None, "request")
    }
    assert {"job_id", "users", "place", "bench_time_s"} <= keys
    assert [key for key in keys if re.search("[a-z_]{3}", details_said(Text("zh"), {key: 1}))] == []


def test_details_leave_out_what_nobody_filled_in() -> None:
    request = {"mounting": {"coaxiality_mm": None, "by": ""}, "step_percent": 20.0,
               "models": ["hybrid"], "bench_clear": False}  # fmt: skip
    details = {"job_id": "7ed3", "kind": "calibrate", "request": request}
    assert details_said(Text("en"), details) == (
        "job: 7ed3; kind: calibrate; Step size, %: 20; Models: physics + Gaussian process"
    )
    assert details_said(Text("zh"), {"done": False, "state": "done"}) == "完成: 否; 状态: 完成"
    assert details_said(Text("zh"), {"address": "test"}) == "地址: test"
    use = {"kind": "records-use", "request": {"model": 3, "reason": "it is better"}}
    assert details_said(Text("en"), use) == "kind: records-use; Model: 3; Reason: it is better"
    trigger = {"kind": "record", "request": {"trigger": {"signal": "output_speed_rpm"}}}
    assert details_said(Text("en"), trigger).endswith(": Output, speed")
