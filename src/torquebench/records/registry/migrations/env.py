"""Environment of Alembic: the registry passes its open connection."""

from alembic import context

from torquebench.records.registry.entries import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
context.run_migrations()
