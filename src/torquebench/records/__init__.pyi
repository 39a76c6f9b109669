from .chain import (
    ChainHead as ChainHead,
    Link as Link,
    broken_links as broken_links,
)
from .edges.archive import (
    EDGE_ARCHIVE as EDGE_ARCHIVE,
)
from .equipment_kinds import (
    EquipmentKind as EquipmentKind,
)
from .registry.database import (
    REGISTRY_FILE as REGISTRY_FILE,
    REGISTRY_URL as REGISTRY_URL,
    UnavailableError as UnavailableError,
)
from .registry.entries import (
    Activation as Activation,
    Adjustment as Adjustment,
    Amendment as Amendment,
    CalibrationEntry as CalibrationEntry,
    CertificateEntry as CertificateEntry,
    CheckEntry as CheckEntry,
    Component as Component,
    Equipment as Equipment,
    ModelEntry as ModelEntry,
    Report as Report,
    Review as Review,
    RunSummary as RunSummary,
    VerificationEntry as VerificationEntry,
    Zeroing as Zeroing,
)
from .files import (
    json_text as json_text,
    sha256_of_file as sha256_of_file,
)
from .integrity import (
    Finding as Finding,
    IntegrityReport as IntegrityReport,
    anchor_of as anchor_of,
    calibration_changes as calibration_changes,
    check_records as check_records,
    folder_changes as folder_changes,
)
from .streams.raw_stream import (
    RawReading as RawReading,
)
from .runs.sealed_recording import (
    RECORDING as RECORDING,
    from_plain as from_plain,
    recording_content as recording_content,
    recording_file as recording_file,
)
from .registry.registry import (
    Registry as Registry,
)
from .runs.folder import (
    MANIFEST as MANIFEST,
    Recovery as Recovery,
    RunFolder as RunFolder,
    RunWriter as RunWriter,
    new_run_id as new_run_id,
)
from .runs.lock import (
    RunLock as RunLock,
)
from .runs.unfinished import (
    REGISTERS as REGISTERS,
    RunState as RunState,
    UnfinishedRun as UnfinishedRun,
    followers as followers,
    latest_unfinished_calibration as latest_unfinished_calibration,
    unentered_folders as unentered_folders,
    unfinished_runs as unfinished_runs,
)
