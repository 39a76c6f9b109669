"""The version of the registry's tables that this software writes."""

__all__ = ["DEVELOPMENT_VERSIONS", "SCHEMA_VERSION", "VERSIONS_TABLE"]

SCHEMA_VERSION = "0003"
"""The last migration in ``records/registry/migrations/versions``; a test compares both."""

DEVELOPMENT_VERSIONS = ("0001", "0002")
"""Schemas before 0.2.0, which can't be upgraded."""

VERSIONS_TABLE = "alembic_version"
