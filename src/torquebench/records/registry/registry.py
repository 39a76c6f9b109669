"""The registry: every record of a data directory, chained so that no change stays hidden."""

from torquebench.records.registry.calibrations import CalibrationRecords
from torquebench.records.registry.conformity import ConformityRecords
from torquebench.records.registry.equipment import EquipmentRecords
from torquebench.records.runs.states import RunStateRecords

__all__ = ["Registry"]


class Registry(EquipmentRecords, RunStateRecords, CalibrationRecords, ConformityRecords):
    """The records of a data directory, in SQLite by default and in PostgreSQL by URL.

    It is opened by `Registry.open` for a data directory, or by a database URL and the data
    directory; see `Database`. Records are added and amended, never changed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from torquebench.records.registry.entries import Equipment
    >>> with tempfile.TemporaryDirectory() as folder, Registry.open(Path(folder)) as registry:
    ...     registry.add_equipment(Equipment("transducer", "T-1", range_nm=2000.0))
    ...     [equipment.serial for equipment in registry.equipment()], registry.head().sequence
    (['T-1'], 2)
    """
