from .access.actors import (
    Actor as Actor,
)
from .live.alarms import (
    AlarmView as AlarmView,
    StopReport as StopReport,
)
from .bench_service import (
    BenchService as BenchService,
)
from .access.clients import (
    Client as Client,
)
from .settings.differences import (
    Difference as Difference,
)
from .jobs.job import (
    JobPoint as JobPoint,
    JobStage as JobStage,
    JobView as JobView,
    PendingPrompt as PendingPrompt,
    Problem as Problem,
)
from .jobs.queue import (
    QueueItem as QueueItem,
    QueueView as QueueView,
)
from .access.lease import (
    LeaseState as LeaseState,
)
from .live.formulas import (
    FORMULA_NAMES as FORMULA_NAMES,
    RESULT_UNITS as RESULT_UNITS,
    computed as computed,
    names_in as names_in,
)
from .live.hub import (
    SIGNALS as SIGNALS,
    STALE_AFTER_S as STALE_AFTER_S,
    Connection as Connection,
    LatestValue as LatestValue,
    LiveHub as LiveHub,
    LiveTrend as LiveTrend,
    TORQUE_SIGNALS as TORQUE_SIGNALS,
)
from .live.layout import (
    BandLayout as BandLayout,
    ComputedChannel as ComputedChannel,
    LiveLayout as LiveLayout,
    LoopLayout as LoopLayout,
    Scale as Scale,
    View as View,
)
from .live.markers import (
    Marker as Marker,
)
from .live.spans import (
    Histogram as Histogram,
    Spectrum as Spectrum,
    histogram as histogram,
    spectrum as spectrum,
)
from .access.people import (
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
from .jobs.log import (
    EndedJob as EndedJob,
)
from .records.views import (
    CalibrationDetail as CalibrationDetail,
    ErrorCurve as ErrorCurve,
    InterruptedView as InterruptedView,
    RunDetail as RunDetail,
    RunPage as RunPage,
    RunTable as RunTable,
    UnfinishedView as UnfinishedView,
)
from .settings.documents import (
    SECTIONS as SECTIONS,
    Section as Section,
    SettingsChange as SettingsChange,
    SettingsItem as SettingsItem,
    read_upload as read_upload,
)
from .records.queries import (
    MEDIA as MEDIA,
    RecordQueries as RecordQueries,
)
from .live.snapshot import (
    BenchSnapshot as BenchSnapshot,
    BenchState as BenchState,
    CompensationState as CompensationState,
    SideSnapshot as SideSnapshot,
)
from .store import (
    Event as Event,
)
