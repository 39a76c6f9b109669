"""The panel's service: the single owner of one open bench, for pages and HTTP clients alike.

`BenchService.open(description, data_dir)` opens the bench. Everything may be called from any
thread, returns frozen values, and raises `TorquebenchError` (found, allowed, remedy) when it
refuses. Calls that only look take no actor; calls that do something take an `Actor` first: who
is signed in, by which session. `actor = service.people.actor(token)` finds it.

Looking
    - `snapshot()` -> `BenchSnapshot`: both sides, compensation, efficiency, connection, alarms,
      job, who commands. Cheap enough for every repaint.
    - `live.since(sequence, signals=None)` -> `LiveIncrement`; `live.trend(seconds, signals=None,
      points=600)` -> `LiveTrend` (lowest and highest kept); `live.latest()`; `SIGNALS`.

People (`people`): roles "operator" < "metrologist" < "administrator"
    - `setup_code` (str while there is no administrator, else None), `set_up(code, name, password,
      address)` -> token; `sign_in(name, password, address)` -> token; `sign_out(token)`;
      `actor(token)` -> `Actor(name, role, session_id, ...)` or raises `NotSignedInError`.
    - `confirm_password(actor, password)`: before signing; `change_password(actor, old, new)`.
    - `users(actor)`, `add_user(actor, name, role, password)`, `change_user(actor, name, role=None,
      active=None, password=None)`; `clients(actor)`, `add_client(actor, name, role)` -> token shown
      once, `revoke_client(actor, name)`.

Command lease (`lease`): one session commands, others watch
    - `state()` -> `LeaseState(holder, since, idle_s, ...)`, `take(actor, force=False)`,
      `give_back(actor)`, `may_take(actor)` -> (bool, reason). Commands keep it alive.

Work (`jobs`): one at a time, each needs the lease
    - `jobs.preview(kind, request)` -> `JobPreview` (steps, duration, limits; nothing moves).
    - `jobs.start(actor, kind, request)` -> `JobView`; kinds and their requests (pydantic) are in
      `JOB_KINDS`: "calibrate", "compare-models", "verify", "zero", "check", "reducer-test",
      "certificate".
    - `jobs.current` / `jobs.get(job_id)` -> `JobView` (state, stages, progress, prompt, error,
      result); `jobs.points(job_id, since=0)` -> points as they come, with reading, standard, error.
    - `jobs.pause(actor, job_id)`, `resume`, `abort(actor, job_id, reason)`;
      `jobs.answer(actor, prompt_number, done)`.
    - `activate(actor, model_id, reason)`, `sign_off(actor, calibration_id, password, accepted,
      remark)`.

Alarms and stop
    - `alarms()` -> list of `AlarmView` (number, level, found, allowed, remedy, who acknowledged);
      `acknowledge(actor)`; `stop(actor, reason)` and `stop_here(reason)` (no lease needed).

Records (`records`): `search`, `run`, `calibrations`, `calibration`, `models`, `compare`, `drift`,
`certificates`, `certificate_file`, `export_zip`, `figure data`: ids in, values out.

Settings (`settings`): `sections()`, `get(section)`, `preview(section, document)` -> differences,
`change(actor, section, document, reason)`, `history()`, `undo(actor, change_id)`.
"""

from torquebench.panel.service.bench_service import BenchService
from torquebench.panel.service.live import (
    SIGNALS,
    STALE_AFTER_S,
    LatestValue,
    LiveHub,
    LiveIncrement,
    LiveTrend,
    Signal,
)
from torquebench.panel.service.problems import (
    BusyError,
    LeaseError,
    LockedOutError,
    NotFoundError,
    NotSignedInError,
    PermissionDeniedError,
    SignInError,
)
from torquebench.panel.service.snapshot import BenchSnapshot, CompensationState, SideSnapshot

__all__ = [
    "SIGNALS",
    "STALE_AFTER_S",
    "BenchService",
    "BenchSnapshot",
    "BusyError",
    "CompensationState",
    "LatestValue",
    "LeaseError",
    "LiveHub",
    "LiveIncrement",
    "LiveTrend",
    "LockedOutError",
    "NotFoundError",
    "NotSignedInError",
    "PermissionDeniedError",
    "SideSnapshot",
    "SignInError",
    "Signal",
]
