import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.bench.audit.chain import AUDIT_FILE, AuditCheck, audit_end, check_audit
from torquebench.bench.audit.entries import AuditLog, read_audit
from torquebench.bench.audit.writing import AuditedDrive
from torquebench.bench.drivers.base import DriveState
from torquebench.bench.safety.alarms import Alarm, AlarmKind
from torquebench.errors import BenchError, InterlockError


@dataclass
class ToldDrive:
    """Notes what it is told; `meanwhile` happens while it obeys."""

    told: list[tuple[Any, ...]] = field(default_factory=list)
    meanwhile: Any = None

    def __getattr__(self, name: str) -> Any:
        def told(*arguments: Any) -> None:
            self.told.append((name, *arguments))
            if self.meanwhile is not None:
                self.meanwhile()

        return told

    def state(self) -> DriveState:
        return DriveState(True, 0.0, None)


ALARM = Alarm(AlarmKind.STOP, "test", "stop", "", "go on", 1.0)


def drive_on(log: AuditLog, told: Any, alarms: list[Alarm], by: Any = "procedure") -> AuditedDrive:
    return AuditedDrive(told, "output", log, by, lambda: alarms[-1] if alarms else None, 0.2)


def test_lines_are_bound_to_bench_run_and_operator(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "audit", bench="Bench 1", bench_time=lambda: 12.5)
    drive = drive_on(log, ToldDrive(), [])
    drive.enable()
    run = tmp_path / "run"
    run.mkdir()
    log.begin_run("run-1", "A. Tester", run)
    drive.command_torque(120.0, 400.0)
    drive.feed_watchdog()
    log.end_run()
    drive.disable()
    log.close()
    lines = list(read_audit(tmp_path / "audit"))
    assert [line["command"] for line in lines] == ["enable", "command_torque", "disable"]
    assert {line["bench"] for line in lines} == {"Bench 1"}
    (part,) = read_audit(run / AUDIT_FILE)
    assert part == lines[1]
    assert (part["run"], part["operator"], part["by"]) == ("run-1", "A. Tester", "procedure")
    assert (part["torque_nm"], part["bench_time_s"], part["side"]) == (120.0, 12.5, "output")
    assert "run" not in lines[2]


def test_a_command_that_fails_is_in_the_log_with_its_error(tmp_path: Path) -> None:
    log = AuditLog(tmp_path, bench="b")

    def fail() -> None:
        raise BenchError("the drive doesn't answer")

    with pytest.raises(BenchError):
        drive_on(log, ToldDrive(meanwhile=fail), []).enable()
    asked, failed = read_audit(tmp_path)
    assert (asked["event"], failed["event"]) == ("command", "command failed")
    assert failed["error"] == "BenchError: the drive doesn't answer"


def test_no_command_of_a_procedure_passes_a_latched_alarm(tmp_path: Path) -> None:
    log, told, alarms = AuditLog(tmp_path, bench="b"), ToldDrive(), [ALARM]
    drive = drive_on(log, told, alarms)
    with pytest.raises(InterlockError, match="stop requested"):
        drive.command_torque(10.0, 1.0)
    drive.command_torque(0.0, 1.0)  # it is on its way there already, and faster
    drive.disable()
    assert told.told == [("disable",)]
    assert [line["event"] for line in read_audit(tmp_path)] == ["refused", "command"]


def test_a_command_that_meets_an_alarm_on_its_way_is_taken_back(tmp_path: Path) -> None:
    log, alarms = AuditLog(tmp_path, bench="b"), list[Alarm]()
    told = ToldDrive(meanwhile=lambda: alarms.append(ALARM))
    with pytest.raises(InterlockError):
        drive_on(log, told, alarms).command_torque(10.0, 1.0)
    assert told.told == [("command_torque", 10.0, 1.0), ("ramp_to_zero", 0.2)]


def test_a_large_log_is_put_aside_and_old_ones_go(tmp_path: Path) -> None:
    log = AuditLog(tmp_path, bench="b", largest_bytes=2000, kept_files=3)
    for number in range(200):
        log.write("line", number=number)
    log.close()
    aside = sorted(tmp_path.glob("audit-*.jsonl"))
    assert len(aside) == 3
    assert all(file.stat().st_size < 2300 for file in aside)
    lines = list(read_audit(tmp_path))
    numbers = [line["number"] for line in lines if line["event"] == "line"]
    assert numbers == list(range(numbers[0], 200))
    assert lines[-1]["log_line"] > len(lines) > 10, "some were dropped"
    assert check_audit(tmp_path) == AuditCheck(len(lines), [])
    aside[0].unlink()
    ((_, what),) = check_audit(tmp_path).problems
    assert what.startswith("lines ")
    assert what.endswith(" are missing")


def test_lines_of_many_threads_stay_whole_and_torn_ones_are_left_out(tmp_path: Path) -> None:
    log = AuditLog(tmp_path, bench="b")
    threads = [
        threading.Thread(target=lambda n=n: [log.write("line", n=n, i=i) for i in range(50)])
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    log.close()
    file = tmp_path / AUDIT_FILE
    file.write_bytes(file.read_bytes() + b'{"event": "torn')
    assert len(list(read_audit(tmp_path))) == 200
    assert check_audit(tmp_path) == AuditCheck(200, []), "the next line may be under way"
    log.write("line", i=50)
    log.close()
    *_, cut, last = read_audit(tmp_path)
    assert (cut["event"], cut["text"]) == ("incomplete line removed", '{"event": "torn')
    assert (last["i"], last["log_line"]) == (50, 202)
    assert check_audit(tmp_path) == AuditCheck(202, [])


def chained_log(folder: Path, lines: int = 20) -> bytes:
    log = AuditLog(folder, bench="b")
    for number in range(lines):
        log.write("command", torque_nm=1192.0, i=number)
    log.close()
    return (folder / AUDIT_FILE).read_bytes()


@settings(max_examples=60)
@given(place=st.integers(min_value=0), bit=st.integers(0, 7))
def test_a_flipped_bit_in_the_log_is_found_once(
    tmp_path_factory: pytest.TempPathFactory, place: int, bit: int
) -> None:
    folder = tmp_path_factory.mktemp("log")
    content = bytearray(chained_log(folder))
    content[place % (len(content) - 1)] ^= 1 << bit
    (folder / AUDIT_FILE).write_bytes(content)
    ((_, what),) = check_audit(folder).problems
    assert what == "was changed after it was written"


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda lines: lines[:5] + lines[7:], "line 6: 2 lines before it are missing"),
        (lambda lines: lines[3:], "lines 1 to 3 are missing"),
        (lambda lines: lines[:-1], "line 20 is noted in run-1, the log ends with 19"),
        (lambda _lines: [], "line 20 is noted in run-1, there is no log"),
        (lambda lines: [*lines[:5], b'{"event": "command"}\n', *lines[5:]], "line 6: was changed"),
    ],
)
def test_removed_and_added_lines_are_found(tmp_path: Path, change: Any, found: str) -> None:
    content = chained_log(tmp_path)
    noted = [(audit_end(tmp_path / AUDIT_FILE), "run-1")]
    assert noted[0][0].line == 20
    assert check_audit(tmp_path, noted) == AuditCheck(20, [])
    (tmp_path / AUDIT_FILE).write_bytes(b"".join(change(content.splitlines(keepends=True))))
    ((where, what),) = check_audit(tmp_path, noted).problems
    assert found in f"{where}: {what}"


def test_a_log_that_was_rewritten_lacks_what_was_noted(tmp_path: Path) -> None:
    chained_log(tmp_path)
    noted = [(audit_end(tmp_path / AUDIT_FILE), "run-1")]
    (tmp_path / AUDIT_FILE).unlink()
    chained_log(tmp_path, 30)  # as a bench that is opened after the folder was deleted
    ((_, what),) = check_audit(tmp_path, noted).problems
    assert what == "line 20 is noted in run-1, the log has another one"


def test_lines_from_before_the_chain_are_covered_by_it(tmp_path: Path) -> None:
    old = b'{"event": "bench opens"}\n{"event": "bench closes"}\n'
    (tmp_path / AUDIT_FILE).write_bytes(old)
    content = chained_log(tmp_path, 3)
    assert check_audit(tmp_path) == AuditCheck(5, [])
    (tmp_path / AUDIT_FILE).write_bytes(content.replace(b"opens", b"close"))
    ((_, what),) = check_audit(tmp_path).problems
    assert what == "the lines before it were changed"


def test_a_disk_that_fails_is_reported_once_and_keeps_no_command(tmp_path: Path) -> None:
    blocked = tmp_path / "audit"
    blocked.write_text("a file where the folder should be")
    log, failures = AuditLog(blocked, bench="b"), list[str]()
    log.on_failure = failures.append
    told = ToldDrive()
    drive = drive_on(log, told, [])
    drive.enable()
    drive.command_torque(1.0, 1.0)
    assert [each[0] for each in told.told] == ["enable", "command_torque"]
    assert len(failures) == 1
    blocked.unlink()
    drive.disable()
    log.close()
    assert [line["command"] for line in read_audit(blocked)] == ["disable"]


def test_the_supervisor_waits_for_no_disk(tmp_path: Path) -> None:
    log, told = AuditLog(tmp_path, bench="b"), ToldDrive()
    log.write_soon("bench opens")
    drive = drive_on(log, told, [], by="supervisor")
    with log._lock:  # as if the disk hung: nobody can write
        ramping = threading.Thread(target=lambda: (drive.ramp_to_zero(0.2), drive.disable()))
        ramping.start()
        ramping.join(120.0)
        assert not ramping.is_alive()
    assert told.told == [("ramp_to_zero", 0.2), ("disable",)]
    log.close()
    lines = list(read_audit(tmp_path))
    assert [line.get("command") for line in lines] == [None, "ramp_to_zero", "disable"]
    log.write("bench opens")  # a closed log opens again
    log.close()
    assert len(list(read_audit(tmp_path))) == 4
