"""Tables of 0.2.0, the oldest version whose registries can be upgraded."""

from torquebench.records.registry.migrations.steps import create_tables

revision = "0003"
down_revision = None

COLUMNS = {
    "activations": "transducer_key counter_key model_key activated operator reason",
    "adjustments": "equipment_key what before after performed performed_by checked_by reason",
    "amendments": "subject subject_key amended amended_by reason changes",
    "audit_ends": "log line sha256 recorded",
    "calibrations": (
        "run_key transducer_key counter_key standard_key performed measured_by range_nm "
        "valid_low_nm valid_high_nm due points data_sha256 profile_name profile_sha256 "
        "simulated files summary"
    ),
    "certificates": "number calibration_key supersedes_key issued authorised_by files summary",
    "chain": "sequence table key recorded content previous_sha256 sha256",
    "checks": (
        "transducer_key standard_key model_key run_key performed measured_by verdict "
        "worst_percent_fs tolerance_percent_fs simulated summary"
    ),
    "components": "whole_key part_key role change performed performed_by reason",
    "equipment": "kind serial recorded",
    "equipment_descriptions": "equipment_key manufacturer model range_nm details recorded",
    "models": "calibration_key kind file file_sha256 range_nm side metrics created",
    "reports": (
        "equipment_key number laboratory performed due measured_by checked_by valid_low_nm "
        "valid_high_nm expanded_uncertainty_percent file file_sha256 recorded"
    ),
    "reviews": "subject subject_key checked checked_by accepted remark",
    "run_ends": "run_key finished status reason manifest_sha256",
    "runs": (
        "run_id kind started side operator bench simulated profile_name profile_sha256 "
        "software_version folder"
    ),
    "verifications": "model_key run_key performed measured_by data_sha256 simulated summary",
    "zeroings": "transducer_key run_key performed zero_hz zero_nm temperature_c simulated",
}


def upgrade() -> None:
    """Create all tables."""
    create_tables(COLUMNS)
