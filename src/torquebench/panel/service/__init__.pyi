from .actors import (
    ROLES as ROLES,
    Actor as Actor,
    Role as Role,
    allows as allows,
)
from .alarm_views import (
    AlarmView as AlarmView,
    StopReport as StopReport,
)
from .bench_service import (
    JOB_KINDS as JOB_KINDS,
    BenchService as BenchService,
)
from .clients import (
    Client as Client,
)
from .differences import (
    Difference as Difference,
)
from .job_values import (
    JobPoint as JobPoint,
    JobPreview as JobPreview,
    JobResult as JobResult,
    JobStage as JobStage,
    JobView as JobView,
    PendingPrompt as PendingPrompt,
    Problem as Problem,
)
from .lease import (
    LeaseState as LeaseState,
)
from .live import (
    SIGNALS as SIGNALS,
    STALE_AFTER_S as STALE_AFTER_S,
    LatestValue as LatestValue,
    LiveHub as LiveHub,
    LiveIncrement as LiveIncrement,
    LiveTrend as LiveTrend,
    Signal as Signal,
)
from .people import (
    User as User,
)
from .problems import (
    BusyError as BusyError,
    LeaseError as LeaseError,
    LockedOutError as LockedOutError,
    NameTakenError as NameTakenError,
    NotFoundError as NotFoundError,
    NotSignedInError as NotSignedInError,
    PermissionDeniedError as PermissionDeniedError,
    SignInError as SignInError,
)
from .recalling import (
    InterruptedView as InterruptedView,
)
from .record_views import (
    CalibrationDetail as CalibrationDetail,
    CalibrationView as CalibrationView,
    CertificateView as CertificateView,
    ErrorCurve as ErrorCurve,
    ModelView as ModelView,
    RunDetail as RunDetail,
    RunPage as RunPage,
    RunTable as RunTable,
    RunView as RunView,
)
from .settings_documents import (
    SECTIONS as SECTIONS,
    Section as Section,
    SettingsChange as SettingsChange,
    SettingsItem as SettingsItem,
    read_upload as read_upload,
)
from .snapshot import (
    BenchSnapshot as BenchSnapshot,
    CompensationState as CompensationState,
    SideSnapshot as SideSnapshot,
)
from .store import (
    Event as Event,
)
from .table_desk import (
    EnteredTable as EnteredTable,
    EnterTableRequest as EnterTableRequest,
    TableRequest as TableRequest,
    TableView as TableView,
    read_table as read_table,
)
