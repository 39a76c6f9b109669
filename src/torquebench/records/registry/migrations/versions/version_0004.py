"""Version 0.3.0: signatures of calibrations, reviews, activations, amendments and certificates."""

from torquebench.records.registry.migrations.steps import add_columns

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Add the column for signatures."""
    signed = ("activations", "amendments", "calibrations", "certificates", "reviews")
    add_columns("signature", *signed)
