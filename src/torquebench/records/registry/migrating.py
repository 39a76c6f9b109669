"""Upgrade a registry's tables to this version's schema."""

from pathlib import Path

from sqlalchemy import Engine, inspect, text

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.registry.schema_version import (
    DEVELOPMENT_VERSIONS,
    SCHEMA_VERSION,
    VERSIONS_TABLE,
)

_MIGRATIONS = Path(__file__).parent / "migrations"


def upgrade(engine: Engine, *, read_only: bool = False, to: str = SCHEMA_VERSION) -> None:
    """Create or upgrade the tables of a registry.

    Parameters
    ----------
    read_only : bool
        Whether the registry can't be written; then only a registry of this version is accepted.
    to : str
        The version to upgrade to; tests choose an older one.

    Raises
    ------
    RecordError
        Where the database isn't a registry, or a version newer than this one or before 0.2.0 made
        it.
    """
    found = _version(engine)
    if found == SCHEMA_VERSION:
        return
    if found in DEVELOPMENT_VERSIONS:
        raise RecordError(
            Message(
                "the registry {url} has the schema {found} of a version before 0.2.0",
                engine.url.render_as_string(),
                found,
            ),
            Message("the schema {schema_version}", SCHEMA_VERSION),
            "move its file to another folder, then rebuild it from "
            "the runs: torquebench records rebuild",
        )
    if read_only:
        raise RecordError(
            Message(
                "a registry with the schema {found} that can't be written",
                found or "of an empty file",
            ),
            Message("the schema {schema_version}", SCHEMA_VERSION),
            "copy the data directory to a folder with write permission, and open it there",
        )
    # Imported only if needed, because most registries are up to date.
    from alembic import command
    from alembic.config import Config

    known = {path.stem.removeprefix("version_") for path in _MIGRATIONS.glob("versions/version_*")}
    if found is not None and found not in known:
        raise RecordError(
            Message(
                "the registry {url} has the schema {found}", engine.url.render_as_string(), found
            ),
            Message("{schema_version} or older", SCHEMA_VERSION),
            "it was made by a newer torquebench: upgrade this one",
        )
    config = Config()
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    with engine.execution_options(writes=True).begin() as connection:
        if engine.dialect.name == "postgresql":
            # The lock lets two benches that open a new database upgrade it one after the other.
            connection.execute(text("SELECT pg_advisory_xact_lock(7240514)"))
        config.attributes["connection"] = connection
        command.upgrade(config, to)


def _version(engine: Engine) -> str | None:
    """Return the schema's version; None for an empty database."""
    with engine.execution_options(writes=False).connect() as connection:
        tables = inspect(connection).get_table_names()
        if VERSIONS_TABLE in tables:
            found = connection.scalar(text(f"SELECT version_num FROM {VERSIONS_TABLE}"))
            return None if found is None else str(found)
        if tables:
            raise RecordError(
                Message(
                    "{url} holds other tables: {tables}",
                    engine.url.render_as_string(),
                    ", ".join(tables[:5]),
                ),
                "an empty database, or a registry of this version or an older one",
                "choose another data directory or database",
            )
    return None
