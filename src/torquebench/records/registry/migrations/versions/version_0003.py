"""The tables of 0.2.0, the first version whose registries are upgraded.

Until a later version exists, the tables are created from `torquebench.records.registry.schema`.
The next version must state them here explicitly, so that both start from the same tables.
"""

from alembic import op

from torquebench.records.registry.migrations.append_only import forbid_changes
from torquebench.records.registry.schema import metadata

__all__ = ["upgrade"]

revision = "0003"
down_revision = None


def upgrade() -> None:
    """Create all tables."""
    metadata.create_all(op.get_bind())
    for table in metadata.sorted_tables:
        forbid_changes(table.name)
