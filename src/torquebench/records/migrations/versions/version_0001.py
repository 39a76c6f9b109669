"""All tables of the first registry, and the triggers that keep them append-only."""

import sqlalchemy as sa
from alembic import op

from torquebench.records.migrations.append_only import forbid_changes

__all__ = ["upgrade"]

revision = "0001"
down_revision = None

TABLES = (
    "amendments",
    "chain",
    "equipment",
    "reviews",
    "runs",
    "adjustments",
    "calibrations",
    "components",
    "equipment_descriptions",
    "reports",
    "run_ends",
    "zeroings",
    "certificates",
    "models",
    "activations",
    "checks",
    "verifications",
)


def upgrade() -> None:
    """Create the tables, from those that others point to to those that point."""
    _tables_without_references()
    _equipment_tables()
    _calibration_tables()
    _model_tables()
    for table in TABLES:
        forbid_changes(table)


def _tables_without_references() -> None:
    op.create_table(
        "amendments",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("subject", sa.Text(), nullable=False),
        sa.Column("subject_key", sa.Integer(), nullable=False),
        sa.Column("amended", sa.DateTime(timezone=True), nullable=False),
        sa.Column("amended_by", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("changes", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_amendments"),
    )
    op.create_index("ix_amendments_subject", "amendments", ["subject", "subject_key"])
    op.create_table(
        "chain",
        sa.Column("sequence", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("table", sa.Text(), nullable=False),
        sa.Column("key", sa.Integer(), nullable=False),
        sa.Column("recorded", sa.Text(), nullable=False),
        sa.Column("content", sa.Text(), nullable=False),
        sa.Column("previous_sha256", sa.String(length=64), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("sequence", name="pk_chain"),
        sa.UniqueConstraint("sha256", name="uq_chain_sha256"),
    )
    op.create_index("ix_chain_row", "chain", ["table", "key"], unique=True)
    op.create_table(
        "equipment",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("serial", sa.Text(), nullable=False),
        sa.Column("recorded", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_equipment"),
    )
    op.create_index("ix_equipment_identity", "equipment", ["kind", "serial"], unique=True)
    op.create_table(
        "reviews",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("subject", sa.Text(), nullable=False),
        sa.Column("subject_key", sa.Integer(), nullable=False),
        sa.Column("checked", sa.DateTime(timezone=True), nullable=False),
        sa.Column("checked_by", sa.Text(), nullable=False),
        sa.Column("accepted", sa.Boolean(), nullable=False),
        sa.Column("remark", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_reviews"),
    )
    op.create_index("ix_reviews_subject", "reviews", ["subject", "subject_key"])
    op.create_table(
        "runs",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("started", sa.DateTime(timezone=True), nullable=False),
        sa.Column("side", sa.Text(), nullable=False),
        sa.Column("operator", sa.Text(), nullable=False),
        sa.Column("bench", sa.Text(), nullable=False),
        sa.Column("simulated", sa.Boolean(), nullable=False),
        sa.Column("profile_name", sa.Text(), nullable=False),
        sa.Column("profile_sha256", sa.String(length=64), nullable=False),
        sa.Column("software_version", sa.Text(), nullable=False),
        sa.Column("folder", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_runs"),
        sa.UniqueConstraint("run_id", name="uq_runs_run_id"),
    )
    op.create_index("ix_runs_started", "runs", ["started", "id"])
    op.create_index("ix_runs_kind_started", "runs", ["kind", "started", "id"])


def _equipment_tables() -> None:
    op.create_table(
        "adjustments",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("equipment_key", sa.Integer(), nullable=False),
        sa.Column("what", sa.Text(), nullable=False),
        sa.Column("before", sa.JSON(), nullable=False),
        sa.Column("after", sa.JSON(), nullable=False),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("performed_by", sa.Text(), nullable=False),
        sa.Column("checked_by", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["equipment_key"], ["equipment.id"], name="fk_adjustments_equipment_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_adjustments"),
    )
    op.create_index("ix_adjustments_equipment_key", "adjustments", ["equipment_key"])
    op.create_table(
        "components",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("whole_key", sa.Integer(), nullable=False),
        sa.Column("part_key", sa.Integer(), nullable=False),
        sa.Column("role", sa.Text(), nullable=False),
        sa.Column("change", sa.Text(), nullable=False),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("performed_by", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["part_key"], ["equipment.id"], name="fk_components_part_key"),
        sa.ForeignKeyConstraint(["whole_key"], ["equipment.id"], name="fk_components_whole_key"),
        sa.PrimaryKeyConstraint("id", name="pk_components"),
    )
    op.create_index("ix_components_part_key", "components", ["part_key"])
    op.create_index("ix_components_whole_key", "components", ["whole_key"])
    op.create_table(
        "equipment_descriptions",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("equipment_key", sa.Integer(), nullable=False),
        sa.Column("manufacturer", sa.Text(), nullable=False),
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("range_nm", sa.Double(), nullable=True),
        sa.Column("details", sa.JSON(), nullable=False),
        sa.Column("recorded", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["equipment_key"], ["equipment.id"], name="fk_equipment_descriptions_equipment_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_equipment_descriptions"),
    )
    op.create_index(
        "ix_equipment_descriptions_equipment_key", "equipment_descriptions", ["equipment_key"]
    )
    op.create_table(
        "reports",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("equipment_key", sa.Integer(), nullable=False),
        sa.Column("number", sa.Text(), nullable=False),
        sa.Column("laboratory", sa.Text(), nullable=False),
        sa.Column("performed", sa.Date(), nullable=True),
        sa.Column("due", sa.Date(), nullable=True),
        sa.Column("measured_by", sa.Text(), nullable=False),
        sa.Column("checked_by", sa.Text(), nullable=False),
        sa.Column("valid_low_nm", sa.Double(), nullable=True),
        sa.Column("valid_high_nm", sa.Double(), nullable=True),
        sa.Column("expanded_uncertainty_percent", sa.Double(), nullable=True),
        sa.Column("file", sa.Text(), nullable=False),
        sa.Column("file_sha256", sa.String(length=64), nullable=False),
        sa.Column("recorded", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["equipment_key"], ["equipment.id"], name="fk_reports_equipment_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_reports"),
    )
    op.create_index("ix_reports_equipment_key", "reports", ["equipment_key"])
    op.create_table(
        "run_ends",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_key", sa.Integer(), nullable=False),
        sa.Column("finished", sa.DateTime(timezone=True), nullable=False),
        sa.Column("status", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("manifest_sha256", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(["run_key"], ["runs.id"], name="fk_run_ends_run_key"),
        sa.PrimaryKeyConstraint("id", name="pk_run_ends"),
        sa.UniqueConstraint("run_key", name="uq_run_ends_run_key"),
    )
    op.create_table(
        "zeroings",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("transducer_key", sa.Integer(), nullable=False),
        sa.Column("run_key", sa.Integer(), nullable=True),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("zero_hz", sa.Double(), nullable=False),
        sa.Column("zero_nm", sa.Double(), nullable=False),
        sa.Column("temperature_c", sa.Double(), nullable=True),
        sa.Column("simulated", sa.Boolean(), nullable=False),
        sa.ForeignKeyConstraint(["run_key"], ["runs.id"], name="fk_zeroings_run_key"),
        sa.ForeignKeyConstraint(
            ["transducer_key"], ["equipment.id"], name="fk_zeroings_transducer_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_zeroings"),
    )
    op.create_index(
        "ix_zeroings_transducer", "zeroings", ["transducer_key", "performed"], unique=False
    )


def _calibration_tables() -> None:
    op.create_table(
        "calibrations",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_key", sa.Integer(), nullable=True),
        sa.Column("transducer_key", sa.Integer(), nullable=False),
        sa.Column("counter_key", sa.Integer(), nullable=False),
        sa.Column("standard_key", sa.Integer(), nullable=True),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("measured_by", sa.Text(), nullable=False),
        sa.Column("range_nm", sa.Double(), nullable=False),
        sa.Column("valid_low_nm", sa.Double(), nullable=False),
        sa.Column("valid_high_nm", sa.Double(), nullable=False),
        sa.Column("due", sa.Date(), nullable=True),
        sa.Column("points", sa.Integer(), nullable=False),
        sa.Column("data_sha256", sa.String(length=64), nullable=False),
        sa.Column("profile_name", sa.Text(), nullable=False),
        sa.Column("profile_sha256", sa.String(length=64), nullable=False),
        sa.Column("simulated", sa.Boolean(), nullable=False),
        sa.Column("files", sa.JSON(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["counter_key"], ["equipment.id"], name="fk_calibrations_counter_key"
        ),
        sa.ForeignKeyConstraint(["run_key"], ["runs.id"], name="fk_calibrations_run_key"),
        sa.ForeignKeyConstraint(
            ["standard_key"], ["equipment.id"], name="fk_calibrations_standard_key"
        ),
        sa.ForeignKeyConstraint(
            ["transducer_key"], ["equipment.id"], name="fk_calibrations_transducer_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_calibrations"),
    )
    op.create_index(
        "ix_calibrations_transducer_key", "calibrations", ["transducer_key"], unique=False
    )
    op.create_table(
        "certificates",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("number", sa.Text(), nullable=False),
        sa.Column("calibration_key", sa.Integer(), nullable=False),
        sa.Column("supersedes_key", sa.Integer(), nullable=True),
        sa.Column("issued", sa.DateTime(timezone=True), nullable=False),
        sa.Column("authorised_by", sa.Text(), nullable=False),
        sa.Column("files", sa.JSON(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["calibration_key"], ["calibrations.id"], name="fk_certificates_calibration_key"
        ),
        sa.ForeignKeyConstraint(
            ["supersedes_key"], ["certificates.id"], name="fk_certificates_supersedes_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_certificates"),
        sa.UniqueConstraint("number", name="uq_certificates_number"),
    )
    op.create_index(
        "ix_certificates_calibration_key", "certificates", ["calibration_key"], unique=False
    )


def _model_tables() -> None:
    op.create_table(
        "models",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("calibration_key", sa.Integer(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("file", sa.Text(), nullable=False),
        sa.Column("file_sha256", sa.String(length=64), nullable=False),
        sa.Column("range_nm", sa.Double(), nullable=False),
        sa.Column("side", sa.Text(), nullable=False),
        sa.Column("metrics", sa.JSON(), nullable=False),
        sa.Column("created", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["calibration_key"], ["calibrations.id"], name="fk_models_calibration_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_models"),
    )
    op.create_index("ix_models_calibration_key", "models", ["calibration_key"])
    op.create_table(
        "activations",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("transducer_key", sa.Integer(), nullable=False),
        sa.Column("counter_key", sa.Integer(), nullable=False),
        sa.Column("model_key", sa.Integer(), nullable=True),
        sa.Column("activated", sa.DateTime(timezone=True), nullable=False),
        sa.Column("operator", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["counter_key"], ["equipment.id"], name="fk_activations_counter_key"
        ),
        sa.ForeignKeyConstraint(["model_key"], ["models.id"], name="fk_activations_model_key"),
        sa.ForeignKeyConstraint(
            ["transducer_key"], ["equipment.id"], name="fk_activations_transducer_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_activations"),
    )
    op.create_table(
        "checks",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("transducer_key", sa.Integer(), nullable=False),
        sa.Column("standard_key", sa.Integer(), nullable=True),
        sa.Column("model_key", sa.Integer(), nullable=True),
        sa.Column("run_key", sa.Integer(), nullable=True),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("measured_by", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text(), nullable=False),
        sa.Column("worst_percent_fs", sa.Double(), nullable=False),
        sa.Column("tolerance_percent_fs", sa.Double(), nullable=False),
        sa.Column("simulated", sa.Boolean(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(["model_key"], ["models.id"], name="fk_checks_model_key"),
        sa.ForeignKeyConstraint(["run_key"], ["runs.id"], name="fk_checks_run_key"),
        sa.ForeignKeyConstraint(["standard_key"], ["equipment.id"], name="fk_checks_standard_key"),
        sa.ForeignKeyConstraint(
            ["transducer_key"], ["equipment.id"], name="fk_checks_transducer_key"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_checks"),
    )
    op.create_index("ix_checks_transducer", "checks", ["transducer_key", "performed"])
    op.create_table(
        "verifications",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("model_key", sa.Integer(), nullable=False),
        sa.Column("run_key", sa.Integer(), nullable=True),
        sa.Column("performed", sa.DateTime(timezone=True), nullable=False),
        sa.Column("measured_by", sa.Text(), nullable=False),
        sa.Column("data_sha256", sa.String(length=64), nullable=False),
        sa.Column("simulated", sa.Boolean(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(["model_key"], ["models.id"], name="fk_verifications_model_key"),
        sa.ForeignKeyConstraint(["run_key"], ["runs.id"], name="fk_verifications_run_key"),
        sa.PrimaryKeyConstraint("id", name="pk_verifications"),
    )
    op.create_index("ix_verifications_model_key", "verifications", ["model_key"])
    op.create_index(
        "ix_activations_chain",
        "activations",
        ["transducer_key", "counter_key", "id"],
    )
