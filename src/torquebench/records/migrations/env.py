"""What Alembic runs: the registry hands in its open connection."""

from alembic import context

from torquebench.records.schema import Base

context.configure(connection=context.config.attributes["connection"], target_metadata=Base.metadata)
context.run_migrations()
