"""Alembic's environment: runs the migrations on the connection that the registry passes."""

from alembic import context

from torquebench.records.registry.entries import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
context.run_migrations()
