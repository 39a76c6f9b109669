"""Every column of files, documents and signals has a unit, a description and its translation."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests.counting import counted
from tests.unit.station.test_run_journal import PROBES, block, channel, times

from torquebench.bench.devices.labels import Point
from torquebench.bench.devices.steady import SETTINGS, STEADY_FIELDS
from torquebench.calibration.data import OPTIONAL_COLUMNS, REQUIRED_COLUMNS
from torquebench.chain.readings import QUANTITIES
from torquebench.columns import COLUMNS, Column, column_of
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.service import SIGNALS
from torquebench.panel.text import LANGUAGES, Text
from torquebench.procedures.turning.empty import EmptyTable
from torquebench.procedures.turning.stepping import StepTable
from torquebench.records import RunFolder
from torquebench.signals import EdgeBlock
from torquebench.station.journal import RunJournal
from torquebench.tables.readings import ADDED_COLUMNS, READING_COLUMNS
from torquebench.translations import translated
from torquebench.units import unit_of_name

WRITTEN = {
    "a calibration": (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS),
    "readings": READING_COLUMNS,
    "compensated readings": ADDED_COLUMNS,
    "an empty run": EmptyTable.COLUMNS,
    "step torques": StepTable.COLUMNS,
    "a steady value": STEADY_FIELDS,
    "its settings": tuple(SETTINGS),
    "a point": tuple(vars(Point())),
    "a recorder": ("start_s", "stop_s", "samples"),
    "counted windows": tuple(counted(EdgeBlock(np.arange(100) * 1000, 0, 100_000, 1e8), 1e-4)),
    "readings of windows": ("reading_nm", "counter_nm"),
    "encoder samples": ("time_s", "angle_counts", "angle_rad"),
    "temperature probes": ("temperatures-ambient_c", "temperatures-input_transducer_c"),
    "edges": ("tick", "timebase_hz"),
    "an exported event": ("unix_time_s",),
    "signals": tuple(signal.name for signal in SIGNALS),
}


@pytest.mark.parametrize("table", WRITTEN)
def test_every_written_column_is_known(table: str) -> None:
    columns = [column_of(name) for name in WRITTEN[table]]
    assert [column.name for column in columns if not (column.unit and column.description)] == []


def test_every_raw_sample_states_unit_and_description(tmp_path: Path) -> None:
    writer = RunFolder.create(tmp_path, {}, kind="test")
    RunJournal(writer, PROBES).write(block(0, {"input_torque": channel(times(0), 60e3)}))
    schema = pq.read_schema(writer.seal().path / "raw.parquet")
    assert len(schema.names) > 20
    for field in schema:
        assert field.metadata[b"unit"], field.name
        assert field.metadata[b"description"], field.name
    assert schema.field("output_speed_rad_s").metadata[b"unit"] == b"rad/s"


@pytest.mark.parametrize("column", COLUMNS.values(), ids=lambda column: column.name)
def test_every_description_has_its_translation(column: Column) -> None:
    assert translated(column.description, "zh") != column.description
    for language in LANGUAGES:
        assert column_title(Text(language), f"output_{column.name}") != column.name


def test_a_unit_is_that_of_the_name() -> None:
    """Only numbers without a unit have names without one."""
    ending = re.compile(r"_(nm|rpm|rad|rad_s|rad_s2|deg|s|h|hz|c|percent|counts|nm_per_s)$")
    for column in COLUMNS.values():
        assert bool(unit_of_name(column.name)) == bool(ending.search(column.name)), column.name


def test_compensated_torque_and_raw_samples_are_told_apart() -> None:
    """An exported README called both the torque by the zero in use."""
    assert column_of("output_torque_nm").title == "output, compensated torque"
    assert column_of("output_torque_nm", samples=True).title == "output, raw torque"


def test_a_column_of_another_origin_keeps_the_unit_of_its_document() -> None:
    oil = replace(column_of("oil_pressure"), stated_unit="bar")
    assert oil.sentence == "As its name says, in bar."


def test_a_quantity_of_readings_is_a_column() -> None:
    assert {name: COLUMNS[name].description for name in QUANTITIES} == QUANTITIES
