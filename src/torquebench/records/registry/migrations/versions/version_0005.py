"""Version 0.3.0: mean temperature of a calibration."""

from torquebench.records.registry.migrations.steps import add_columns

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add the column; calibrations before it state no temperature."""
    add_columns("temperature_c", "calibrations")
