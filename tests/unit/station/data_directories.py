"""A data directory as a bench leaves it, without the bench: registry, runs, model, audit log."""

from datetime import UTC, date, datetime
from pathlib import Path

from torquebench.bench.audit.entries import AUDIT_FOLDER, AuditLog
from torquebench.calibration import CalibrationData
from torquebench.records import CalibrationEntry, Equipment, Registry, Report, RunFolder, RunSummary

__all__ = ["filled_directory"]


def filled_directory(data: Path) -> Path:
    """Fill a new data directory with three runs, one of them a calibration with a model."""
    log = AuditLog(data / AUDIT_FOLDER, bench="Bench 1")
    with Registry.open(data) as registry:
        registry.add_equipment(Equipment("drive", "DRIVE-1"))
        registry.add_equipment(Equipment("transducer", "T-1", "HBK", "T40B", 2000.0))
        registry.fit_component(("bench", "Bench 1"), ("drive", "DRIVE-1"), "output.drive")
        registry.add_report(Report("calibrator", "TC-1", "C-77", due=date(2099, 1, 1)))
        log.write("bench opens")
        for number in (1, 2, 3):
            kind = "calibrate-output" if number == 2 else "zero"
            known = {"registry_head": str(registry.head()), "operator": "Ana"}
            writer = RunFolder.create(data / "runs", known, kind=kind, run_id=f"run-{number}")
            started = datetime.now(UTC)
            registry.add_run(
                RunSummary(
                    run_id=writer.run_id,
                    kind=kind,
                    started=started,
                    simulated=True,
                    software_version="0.2.0",
                    folder=writer.path,
                    side="output",
                )
            )
            log.begin_run(writer.run_id, "Ana", writer.path)
            log.write("run begins")
            log.write("command", torque_nm=800.0 if number == 2 else 0.0)
            writer.document("start", {"uid": "1"})
            log.write("run ends")
            log.end_run()
            registry.end_run(writer.seal())
        table = CalibrationData(
            [0.1, 5.2, 10.1],
            [0.0, 5.0, 10.0],
            [1, 1, 2],
            [1, 1, 1],
            range_nm=10.0,
            side="output",
            transducer_serial="T-1",
            counter_identity="C/1",
        )
        entry = registry.add_calibration(
            CalibrationEntry.of_points(
                table, run_id="run-2", standard_serial="TC-1", performed=datetime.now(UTC)
            )
        )
        model = data / "models" / "run-2-polynomial.json"
        model.parent.mkdir()
        model.write_text("{}", encoding="utf-8")
        registry.add_model(entry, kind="polynomial", file=model, side="output", metrics={})
        log.write("alarm", found="1 2")
        log.write("bench closes")
        log.close()
        registry.add_audit_end(data / AUDIT_FOLDER, log.end.line, log.end.sha256)
    return data
