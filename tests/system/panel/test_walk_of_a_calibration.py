"""The functions from the press of "calibrate" to the stored model are those of the architecture."""

import re
import threading
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import torquebench
from torquebench.panel.service import Actor, BenchService

ROOT = Path(torquebench.__file__).parent
PAGE = ROOT.parents[1] / "docs" / "architecture.md"
CHIEF = Actor("Chief", "administrator", "chief")
ANA = Actor("ana", "metrologist", "client-1", "client")
ENDS = ("take", "Station.run", "fit_models", "Registry.add_model")
BESIDE = {"rehearse", "_Loader._zero", "zero", "measure_zero"}
"""What takes the first points in place of `Station.run`, and zeros."""


def test_the_architecture_lists_every_function_of_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = re.search(r"25 functions, .*?: ((?:`[\w.]+`(?:, )?)+)\.", PAGE.read_text())
    assert listed is not None
    names = re.findall(r"`([\w.]+)`", listed[1])
    assert len(names) == len(set(names)) == 25
    passed: set[str] = set()

    def watch(frame: FrameType, event: str, _argument: Any) -> None:
        if event != "call" or frame.f_code.co_qualname not in ENDS:
            return
        caller: FrameType | None = frame
        while caller is not None:
            if caller.f_code.co_filename.startswith(str(ROOT)):
                passed.add(caller.f_code.co_qualname)
            caller = caller.f_back

    with BenchService.open(None, tmp_path, fast=True) as service:
        service.clients.add(CHIEF, ANA.name, ANA.role)
        starts = threading.Thread.start
        monkeypatch.setattr(threading.Thread, "start", lambda thread: watched(thread))

        def watched(thread: threading.Thread) -> None:
            if thread.name == "job calibrate":
                threading.setprofile(watch)
            starts(thread)
            threading.setprofile(None)  # type: ignore[arg-type]

        request = {"side": "output", "step_percent": 50.0, "models": ["polynomial-2"]}
        job = service.start(ANA, "calibrate", request, bench_clear=True)
        while job.open:
            job = service.jobs.wait(job.job_id, 1.0)
    assert job.state == "done", job.problem
    begun = {"begin", "BenchService.start", "JobRunner.start"}
    known = {name.rpartition(".")[2] for name in names}
    assert {name for name in passed - BESIDE if name.rpartition(".")[2] not in known} == set()
    assert known - {name.rpartition(".")[2] for name in passed | begun} == set()
