"""What is due for calibration, from certificates and calibrations."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.operations import OPERATIONS, PackagedLibrary, Place
from torquebench.progress import NO_PROGRESS
from torquebench.records import CalibrationEntry, Registry, Report

TODAY = datetime.now(UTC)


def calibrated(*, days_ago: int, due_in: int) -> CalibrationEntry:
    torque = np.array([-50.0, 50.0])
    reading = torque * (1.0 + 1e-6 * days_ago)
    data = CalibrationData(
        reading, torque, [1, 1], [1, 1], 50.0, transducer_serial="T-1", counter_identity="C-1"
    )
    performed = TODAY - timedelta(days=days_ago)
    due = (TODAY + timedelta(days=due_in)).date()
    return CalibrationEntry.of_points(data, performed=performed, due=due)


def certificate(serial: str, number: str, due_in: int | None) -> Report:
    due = None if due_in is None else (TODAY + timedelta(days=due_in)).date()
    return Report("calibrator", serial, number, due=due)


def test_the_most_urgent_comes_first_and_an_overdue_one_fails(tmp_path: Path) -> None:
    due = OPERATIONS["records due"]

    def listed(within_days: int) -> tuple[list[tuple[str, str]], bool]:
        request = due.request.model_validate({"within_days": within_days})
        result = due.run(Place("Ana", PackagedLibrary(), registry), request, NO_PROGRESS)
        return [(row.serial, row.record) for row in result.equipment], result.failed

    with Registry.open(tmp_path) as registry:
        registry.add_calibration(calibrated(days_ago=10, due_in=20))
        registry.add_calibration(calibrated(days_ago=400, due_in=-35))  # entered later
        for report in (
            certificate("R-9", "K-2", 2),
            certificate("R-9", "K-1", -363),
            certificate("R-8", "K-3", 200),
            certificate("R-7", "K-4", None),
        ):
            registry.add_report(report)
        assert listed(0) == ([], False)
        assert listed(30) == ([("R-9", "K-2"), ("T-1", "calibration-1")], False)
        assert [serial for serial, _ in listed(365)[0]] == ["R-9", "T-1", "R-8"]
        registry.add_report(certificate("R-6", "K-5", -3))
        assert listed(0) == ([("R-6", "K-5")], True)
