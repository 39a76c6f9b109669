from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.blocks import CONDITIONS, Block
from torquebench.bench.channels import open_channel
from torquebench.bench.description import default_bench
from torquebench.bench.roles import SIDES, angle_channel
from torquebench.chain import Component, MeasuringChain, Shared, Temperature, Torque
from torquebench.compensation import features, make_model
from torquebench.procedures.messages import move, sleep
from torquebench.procedures.setup import Plan
from torquebench.records import RunFolder
from torquebench.signals import EdgeBlock, Record, SignalFaultKind
from torquebench.station import Station
from torquebench.station.journal import NO_COUNTS, NOT_IN_USE, RunJournal
from torquebench.units import RPM_PER_RAD_S

WINDOWS = 5
PROBES = ("ambient", "input_transducer")
REST = {
    "input_speed_rad_s": 0.0,
    "output_speed_rad_s": 0.0,
    "ambient_c": 23.0,
    "input_transducer_c": 25.0,
}


def channel(time_s: np.ndarray, frequency_hz: float, fault: int = 0) -> Record:
    frequency = np.full(time_s.shape, np.nan if fault else frequency_hz)
    return Record(
        {
            "time_s": time_s,
            "frequency_hz": frequency,
            "reading_nm": frequency / 15.0,
            "fault": np.full(time_s.shape, fault, dtype=np.uint8),
        }
    )


def block(index: int, channels: dict[str, Record], **conditions: float) -> Block:
    start_s, stop_s = index * 0.05, (index + 1) * 0.05
    time_s = start_s + np.arange(50) * 1e-3
    angle = Record({"time_s": time_s, "angle_counts": np.arange(50, dtype=np.int64) + 50 * index})
    known = Record(
        {
            name: np.array([value])
            for name, value in {"time_s": stop_s, **REST, **conditions}.items()
        }
    )
    angles = {angle_channel(side): angle for side in SIDES}
    return Block(start_s, stop_s, records={**channels, **angles, CONDITIONS: known})


def times(index: int) -> np.ndarray:
    return index * 0.05 + (np.arange(WINDOWS) + 0.5) * 0.01


def test_channels_that_come_and_go_and_fail_keep_their_columns(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {}, kind="test")
    journal = RunJournal(writer, PROBES)
    both = {"input_torque": channel(times(0), 60e3), "output_torque": channel(times(0), 61e3)}
    journal.write(block(0, both))
    second = {
        "input_torque": channel(times(1), 60e3),
        "output_torque": channel(times(1), 0.0, SignalFaultKind.NO_PULSES),
        "output_reference": channel(times(1)[2:], 62e3),
    }
    journal.write(block(1, second))
    folder = writer.seal()
    columns = folder.raw().columns
    assert columns["time_s"].tolist() == pytest.approx([*times(0), *times(1)])
    assert columns["output_torque_fault"].tolist() == [0] * 5 + [SignalFaultKind.NO_PULSES] * 5
    assert np.isnan(columns["output_torque_hz"][5:]).all()
    assert columns["output_reference_fault"].tolist() == [NOT_IN_USE] * 7 + [0] * 3
    assert columns["output_reference_hz"][7:].tolist() == [62e3] * 3
    assert (columns["input_reference_fault"] == NOT_IN_USE).all()
    assert columns["input_angle_counts"][:3].tolist() == [5, 15, 25]
    assert (columns["ambient_c"] == 23.0).all()


def test_torque_speed_and_compensated_torque_are_kept(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {}, kind="test")
    journal = RunJournal(writer, PROBES)
    own = channel(times(0), 60e3)
    parts = (Component("own", Shared.LOADING, 0.15), Component("other", Shared.NOTHING, 0.2))
    found = Torque(own["reading_nm"] + 1.0, parts)
    channels = {"input_torque": channel(times(0), 60e3), "output_torque": own}
    first = block(0, channels, output_speed_rad_s=2.0, input_speed_rad_s=np.nan)
    journal.write(replace(first, torques={"output": found}))
    columns = writer.seal().raw().columns
    assert columns["output_torque_nm"].tolist() == own["reading_nm"].tolist()
    assert columns["output_compensated_nm"].tolist() == found.value_nm.tolist()
    assert columns["output_torque_uncertainty_nm"].tolist() == pytest.approx([0.25] * WINDOWS)
    assert np.isnan(columns["input_compensated_nm"]).all()
    assert columns["output_speed_rad_s"].tolist() == [2.0] * WINDOWS
    assert np.isnan(columns["input_speed_rad_s"]).all()  # its encoder is silent


def test_edges_are_kept_where_they_are_asked_for(tmp_path: Path) -> None:
    edges = {"output_torque": EdgeBlock(np.arange(0, 5_000_000, 1667), 0, 5_000_000, 100e6)}
    for wanted in (False, True):
        writer = RunFolder.create(tmp_path, {}, kind="test")
        given = replace(block(0, {"input_torque": channel(times(0), 60e3)}), edges=edges)
        RunJournal(writer, PROBES, edges=wanted).write(given)
        found = list(writer.seal().edges())
        assert len(found) == wanted
    assert found[0].channel == "output_torque"
    np.testing.assert_array_equal(found[0].block.ticks, edges["output_torque"].ticks)


def test_a_block_without_a_window_keeps_nothing(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {}, kind="test")
    RunJournal(writer, PROBES).write(block(0, {"input_torque": channel(np.empty(0), 60e3)}))
    assert writer.seal().raw().rows == 0


def test_a_lost_probe_and_a_silent_encoder_do_not_end_the_recording(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {}, kind="test")
    journal = RunJournal(writer, PROBES)
    whole = block(0, {"input_torque": channel(times(0), 60e3)})
    journal.write(whole)
    unknown = {"input_transducer_c": np.nan, "input_speed_rad_s": np.nan}
    later = block(1, {"input_torque": channel(times(1), 60e3)}, **unknown)
    silent = Record({"time_s": np.empty(0), "angle_counts": np.empty(0, dtype=np.int64)})
    lost = replace(later, records={**later.records, "input_angle": silent})
    assert not lost.follows(whole)
    journal.write(lost)
    columns = writer.seal().raw().columns
    assert columns["input_transducer_c"][:5].tolist() == [25.0] * 5
    assert np.isnan(columns["input_transducer_c"][5:]).all()
    assert columns["input_angle_counts"][5:].tolist() == [NO_COUNTS] * 5
    assert columns["output_angle_counts"][5:].min() >= 0


def test_blocks_kept_together_are_the_same_rows_as_one_by_one(tmp_path: Path) -> None:
    """Speeds, temperatures and counts are a block's own, whatever is kept beside it."""
    blocks = [
        block(
            index,
            {f"{side}_torque": channel(times(index), 60e3) for side in SIDES},
            input_speed_rad_s=0.1 * index,
            output_speed_rad_s=-0.3 * index,
            ambient_c=23.0 + index,
            input_transducer_c=25.0 - index,
        )
        for index in range(4)
    ]
    assert all(later.follows(earlier) for earlier, later in pairwise(blocks))
    parts = (Component("own", Shared.LOADING, 0.15),)
    found = Torque(np.arange(4.0 * WINDOWS), parts)
    whole = replace(Block.join(blocks), torques={"output": found})
    tables = []
    for written in ([whole], [whole.part(each.start_s, each.stop_s) for each in blocks]):
        writer = RunFolder.create(tmp_path, {}, kind="test")
        journal = RunJournal(writer, PROBES)
        for each in written:
            journal.write(each)
        tables.append(writer.seal().raw().columns)
    assert tables[0].keys() == tables[1].keys()
    for name, column in tables[0].items():
        np.testing.assert_array_equal(column, tables[1][name], err_msg=name)
    assert tables[0]["output_speed_rad_s"][-1] == -0.3 * 3
    assert not blocks[2].follows(blocks[0])


def test_the_edges_of_a_sealed_run_give_its_readings_and_torques_again_bit_for_bit(
    tmp_path: Path,
) -> None:
    description = default_bench()
    recording = description.recording.model_copy(update={"edges": True})
    description = description.model_copy(update={"recording": recording})
    size = np.concatenate((np.linspace(0.04, 1.0, 13), np.linspace(0.98, 0.02, 13)))
    torque, up = 500.0 * np.concatenate((size, -size)), np.tile(np.repeat([1.0, -1.0], 13), 2)
    loop = torque + 1e-3 * up * (500.0 - np.abs(torque)) * np.sign(torque)
    model = make_model("hybrid", range_nm=500.0).fit(
        features(torque, up, np.where(torque > 0, 1, 2)), loop
    )
    chain = MeasuringChain(model, (Temperature("data sheet", 0.1, 0.001, 23.0),))

    def loading(station: Station) -> Plan:
        devices = station.devices
        yield from move(devices.mounting, "calibrator")
        yield from move(devices.clamp, True)
        yield from move(devices.input.mode, "locked", devices.output.mode, "driven")
        yield from move(devices.output.drive.power, True)
        station.acquisition.set_compensation("output", ActiveChain(chain, "1", "hybrid"))
        for torque_nm in (300.0, -200.0, 100.0, 0.0):
            yield from move(devices.output.drive.torque, torque_nm)
            yield from sleep(0.2)

    with Station.open(description, tmp_path) as station:
        run = station.run(loading(station), kind="replayed")
        channel = open_channel("output_torque", description, station.drivers, "calibrator")
    folder = RunFolder.open(run.folder)
    folder.verify()
    recorded = folder.raw().columns
    replayed = Record.join(
        [channel.push(each.block) for each in folder.edges() if each.channel == "output_torque"]
    )
    kept = np.isin(recorded["time_s"], replayed.time_s)
    assert np.count_nonzero(~kept) <= 1  # the window that had begun before the recording
    rows = {name: column[kept] for name, column in recorded.items()}
    np.testing.assert_array_equal(rows["output_torque_hz"], replayed["frequency_hz"])
    np.testing.assert_array_equal(rows["output_torque_nm"], replayed["reading_nm"])
    compensated = np.flatnonzero(np.isfinite(rows["output_compensated_nm"]))
    assert compensated.size > 100
    last = slice(compensated[0], None)
    again = ActiveChain(chain, "1", "hybrid").push(
        replayed.at(last),
        {
            "speed_rpm": rows["output_speed_rad_s"][last] * RPM_PER_RAD_S,
            "temperature_c": rows["output_transducer_c"][last],
            "window_s": description.counter.window_s,
        },
        0.0,
    )
    np.testing.assert_array_equal(again.value_nm, rows["output_compensated_nm"][last])
    np.testing.assert_array_equal(
        again.standard_uncertainty_nm, rows["output_torque_uncertainty_nm"][last]
    )
