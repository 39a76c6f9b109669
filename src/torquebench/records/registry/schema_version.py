"""The version of the registry's tables that this software writes."""

from pathlib import Path

SCHEMA_VERSION = max(
    path.stem.removeprefix("version_")
    for path in (Path(__file__).parent / "migrations" / "versions").glob("version_*.py")
)
"""The last migration in ``records/registry/migrations/versions``."""

DEVELOPMENT_VERSIONS = ("0001", "0002")
"""Schemas before 0.2.0, which can't be upgraded."""

VERSIONS_TABLE = "alembic_version"
