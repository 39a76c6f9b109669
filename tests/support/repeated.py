"""What tests repeat and what gives the same each time: new registries, fits to the same points."""

from collections import OrderedDict
from functools import wraps

from sqlalchemy import Engine
from sqlalchemy.exc import OperationalError

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.model import Average, HybridModel
from torquebench.records.registry import database
from torquebench.records.registry.migrating import upgrade
from torquebench.records.registry.schema_version import SCHEMA_VERSION, VERSIONS_TABLE

__all__ = ["remember_schema", "remembered_average"]

KEPT = 64
_averaged = HybridModel._averaged
_averages: OrderedDict[tuple[object, ...], tuple[float, Average]] = OrderedDict()


def remembered_average(
    model: HybridModel, X: FloatArray, y: FloatArray, weights: FloatArray
) -> Average:
    """Average the structures of a chain; of points that came before, return what was found then."""
    key = (model.full_scale_nm_, X.shape, *(each.tobytes() for each in (X, y, weights)))
    if key not in _averages:
        average = _averaged(model, X, y, weights)
        _averages[key] = model.scale_nm_, average
        if len(_averages) > KEPT:
            _averages.popitem(last=False)
    model.scale_nm_, average = _averages[key]
    return average


def remember_schema() -> None:
    """Let this process migrate its first SQLite registry and repeat what that made for others.

    They have the same tables without Alembic's way to them, which takes ten times as long.
    """
    statements: list[str] = []

    @wraps(upgrade)
    def upgraded(engine: Engine, *, read_only: bool = False) -> None:
        """Upgrade; an empty database gets the remembered tables, indexes and triggers."""
        is_empty = engine.dialect.name == "sqlite" and not read_only and not _schema(engine)
        if is_empty and statements:
            try:
                with engine.execution_options(writes=True).begin() as connection:
                    for statement in statements:
                        connection.exec_driver_sql(statement)
            except OperationalError:  # another process has just made them
                upgrade(engine)
            return
        upgrade(engine, read_only=read_only)
        if is_empty:
            statements[:] = _schema(engine)
            statements.append(f"INSERT INTO {VERSIONS_TABLE} VALUES ('{SCHEMA_VERSION}')")

    vars(database)["upgrade"] = upgraded


def _schema(engine: Engine) -> list[str]:
    """Return the statements that made a database, in their order."""
    query = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY rowid"
    with engine.execution_options(writes=False).connect() as connection:
        return list(connection.exec_driver_sql(query).scalars())
