"""Which version of the registry's tables this software writes."""

__all__ = ["SCHEMA_VERSION", "VERSIONS_TABLE"]

SCHEMA_VERSION = "0002"
"""The last migration in ``records/migrations/versions``; a test keeps the two equal."""

VERSIONS_TABLE = "alembic_version"
