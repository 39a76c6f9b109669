"""Alembic migrations of the registry's tables, one file a version."""
