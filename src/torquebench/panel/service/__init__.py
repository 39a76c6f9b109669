"""The panel's service: owner of one open bench, for pages and HTTP clients alike.

`BenchService.open(description, data_dir)` opens the bench. Everything may be called from any
thread, returns frozen values, and raises `TorquebenchError` (found, allowed, remedy) when it
refuses. Calls that only look take no actor; calls that do something take an `Actor` first: who
is signed in, by which session. `actor = service.people.actor(token)` finds it.

Looking
    - `snapshot()` -> `BenchSnapshot`: both sides, compensation, efficiency, connection, alarms,
      job, who commands. Cheap enough for every repaint.
    - `live.since(sequence, signals=None)` and `live.trend(seconds, signals=None, points=600)` ->
      `LiveTrend` (lowest and highest kept); `live.latest()`; `SIGNALS`.

People (`people`): roles "operator" < "metrologist" < "administrator"
    - `setup_code` (str while there is no administrator, else None), `set_up(code, name, password,
      address)` -> token; `sign_in(name, password, address)` -> token; `sign_out(token)`;
      `actor(token)` -> `Actor(name, role, session_id, ...)` or raises `NotSignedInError`.
    - `confirm_password(actor, password)`: before signing; `change_password(actor, old, new)`.
    - `actor(token, touch=False)` for whatever repaints itself: it doesn't keep a session alive.
    - `users(actor)`, `add_user(actor, name, role, password)`, `change_user(actor, name, role=None,
      active=None, password=None)`, `change_password(actor, old, new)`.

Clients (`clients`): programs with a token of their own
    - `add(actor, name, role)` -> (`Client`, token shown once), `list(actor)`, `revoke(actor, id)`,
      `actor(token)`.

Command lease (`lease`): one session commands, others watch
    - `state()` -> `LeaseState(holder, session_id, since_s, idle_s)`, `holds(actor)`, `take(actor,
      force=False)`, `give_back(actor)`, `may_take(actor)` -> (bool, reason). Commands renew it; a
      command takes a free lease.

Work: operations, as jobs one at a time, which needs the lease, as recordings beside it, or at once
    - `jobs.preview(name, request)` -> `Preview` (steps, duration, limits; nothing moves).
    - `start(actor, name, request, bench_clear=, password=)` -> `JobView`; `perform(actor, name,
      request, password=)` -> `Result` of a quick operation. Names, requests and results are those
      of `torquebench.operations.OPERATIONS`.
    - `jobs.current` / `jobs.get(job_id)` / `jobs.recent()` -> `JobView` (state, stages, progress,
      problem, result); `jobs.points(job_id, since=0)` -> list of `JobPoint` as they arrive, with
      `values["reading_nm"]`, `["standard_nm"]`, `["error_nm"]`, `["series"]`, `["branch"]`.
    - `jobs.pause(actor, job_id)`, `resume`, `abort(actor, job_id, reason)`.
    - `jobs.prompt` -> `PendingPrompt(number, text)` or None; `jobs.answer(actor, number, done)`.
    - `unfinished()` -> list of `UnfinishedView`; `records.interrupted(run_id="")` ->
      `InterruptedView` or None: what can be finished and resumed.
    - `log(limit, before)` -> what people did, newest first.

Alarms and stop
    - `alarms(active=False)` -> list of `AlarmView` (number, level, found, allowed, remedy, who
      acknowledged); `acknowledge(actor)`; `stop(actor, reason)` ->
      `StopReport(seconds)`: no lease needed. `confirm_presence(actor)` where the bench asks for it.

Records (`records`): identifiers in, values out, never a path
    - `runs(text, kind=, side=, status=, since=, until=, limit=, offset=)` -> `RunPage`;
      `run(run_id)` -> `RunDetail` (metadata, results, tables, changes); `run_columns(run_id)`,
      `run_trend(run_id, columns, points)` -> rows with lowest and highest.
    - `calibrations()`, `calibration(id)` -> `CalibrationDetail`, `models()`,
      `error_curve(calibration_id, model_id=None)` -> `ErrorCurve`; `transducers()`,
      `drift(serial, tolerance_percent)`; `certificates()`, `certificate_file(number, name)`.

Queue (`queue`): operations that wait for each other
    - `view()` -> `QueueView`; `add(actor, name, request)` -> `QueueItem`, `remove(actor, number)`,
      `move(actor, number, place)`, `start(actor, bench_clear=)`, `pause(actor)`.

Files (`files`): what operations on files read and write
    - `add(bytes, name)` -> reference, which a request names instead of a path; `path(reference)` of
      a file that an operation has written. Such an operation runs in a process of its own.

Settings (`settings`): sections "bench", "profiles", "reducers"
    - `items(section)`, `get(section, name)` -> `SettingsItem` (document, builtin, version);
      `preview(section, name, document)` and `change(actor, section, name, document, reason=,
      version=)` -> `SettingsChange` with `differences`; `history(section)`, `undo(actor, number)`;
      `read_upload(bytes)` -> document of a TOML file.
    - Changes of the bench count after `reopen(actor)`. It replaces `service.live`,
      `service.station` and `service.records`: keep no reference to them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
