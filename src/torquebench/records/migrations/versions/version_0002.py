"""Ends of the audit log, so that lines removed from it are missed."""

import sqlalchemy as sa
from alembic import op

from torquebench.records.migrations.append_only import forbid_changes

__all__ = ["upgrade"]

revision = "0002"
down_revision = "0001"

TABLES = ("audit_ends",)


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "audit_ends",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("log", sa.Text(), nullable=False),
        sa.Column("line", sa.Integer(), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("recorded", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_audit_ends"),
    )
    forbid_changes("audit_ends")
