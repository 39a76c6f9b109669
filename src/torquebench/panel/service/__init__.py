"""The panel's service: owner of one open bench, for pages and HTTP clients alike.

`BenchService.open(description, data_dir)` opens the bench. Everything may be called from any
thread, returns frozen values, and raises `TorquebenchError` (found, allowed, remedy) when it
refuses. Calls that only read take no actor; calls that do something take an `Actor` first: who
is signed in, by which session. `actor = service.people.actor(token)` finds it.

- `snapshot()`: both sides, compensation, connection, alarms, job, lease. Cheap enough for every
  repaint. `live` has rows of all signals, with the lowest and highest value of each.
- `people`: accounts, roles ("operator" < "metrologist" < "administrator"), sessions, passwords.
  `actor(token, touch=False)` is for what repaints itself: it doesn't keep a session alive.
- `clients`: programs with a token of their own.
- `lease`: one session commands, others watch. A command takes a free lease and renews its own.
- `jobs`: operations, one at a time with the lease, recordings beside it. `jobs.preview` moves
  nothing, `start` begins a job, `perform` runs a quick operation at once. Names, requests and
  results are those of `torquebench.operations.OPERATIONS`. `queue`: operations that wait.
- `alarms`, `acknowledge`, `stop` (which needs no lease), `confirm_presence`.
- `records`: runs, calibrations, models, certificates. Identifiers in, values out, never a path.
- `files`: what operations on files read and write, by references instead of paths.
- `settings`: bench, profiles, reducers, with changes, history and undo. Changes of the bench count
  after `reopen(actor)`, which replaces `live`, `station` and `records`: keep no reference to them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
