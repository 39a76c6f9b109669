"""`torquebench records backup`, `restore` and `rebuild`: back up and restore records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.answers import BACKED_UP, REBUILT, RESTORED
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.terminal.console import answer, say, warn
from torquebench.cli.terminal.progress import TerminalProgress

__all__ = ["backup", "rebuild", "restore"]


def backup(
    target: Annotated[
        Path,
        typer.Argument(help="A new folder, or an earlier backup, which is brought up to date."),
    ],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Copy all records into a folder, even while the bench runs.

    The registry is copied in one consistent state, with all files that it names: runs, models,
    certificates, audit log, accounts of the panel. Sealed runs are copied once. The copy is a data
    directory: `--data` lists, verifies and exports it. Exit code 1 if something is damaged and
    couldn't be copied.
    """
    from torquebench.station.backup import back_up

    with TerminalProgress() as progress:
        done = back_up(data_directory(data), target, progress)
    answer(**BACKED_UP.of(done))
    say(
        f"{done.runs} run folders and {done.files} other files copied to {target}, "
        f"{done.known_runs} run folders were there already"
    )
    if done.open_runs:
        say(f"still running, copied in their present state: {', '.join(done.open_runs)}")
    for file in done.outside:
        warn(f"{file} lies outside the data directory and isn't in the backup")
    for problem in done.problems:
        warn(f"not copied: {problem}")
    say(f"chain end {done.head}")
    if done.problems:
        raise typer.Exit(CHECK_FAILED)


def restore(
    source: Annotated[Path, typer.Argument(help="A backup.")],
    replace: Annotated[
        bool,
        typer.Option(
            "--replace", help="Also restore files that differ; the present ones are kept aside."
        ),
    ] = False,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Restore missing files from a backup, and with `--replace` damaged ones.

    The backup is compared with its registry first; nothing is restored from a damaged one, or from
    one with links. Nothing is overwritten: without `--replace` the command refuses if files differ;
    with it, the present files are moved to a separate folder. Data newer than the backup are kept.
    Everything is restored, or nothing.
    """
    from torquebench.station.backup import restore as restore_backup

    with TerminalProgress() as progress:
        done = restore_backup(source, data, replace=replace, progress=progress)
    answer(**RESTORED.of(done))
    say(f"{len(done.restored)} restored, {len(done.replaced)} replaced, {len(done.kept)} kept")
    for title, names in (("restored", done.restored), ("replaced", done.replaced)):
        for name in names[:20]:
            say(f"{title}  {name}")
        if len(names) > 20:
            say(f"{title}  and {len(names) - 20} more")
    for name in done.kept:
        say(f"newer than the backup, kept  {name}")
    for name in done.missing:
        warn(f"the backup doesn't have {name}")
    if done.aside is not None:
        say(f"replaced files are in {done.aside}")
    say(
        "see `torquebench records verify`; runs that are newer than the backup are entered by "
        "`torquebench records rebuild`"
    )


def rebuild(data: DataOption = DEFAULT_DATA) -> None:
    """Rebuild a lost or damaged registry from the run folders, or complete an intact one.

    A damaged registry is kept under another name. Runs, their benches and zeros, calibrations,
    models and certificates are entered again; information that only the registry contained is
    listed. Restore a backup instead if there is one.
    """
    from torquebench.campaign.rebuilding import NOT_REBUILT
    from torquebench.campaign.rebuilding import rebuild as rebuild_registry
    from torquebench.cli.records.checks import checked_directory
    from torquebench.records.signatures import operator_name

    with TerminalProgress() as progress:
        done = rebuild_registry(checked_directory(data), operator_name(), progress)
    answer(**REBUILT.of(done))
    if done.aside is not None:
        say(f"the previous registry is in {done.aside}")
    for what in done.mended:
        say(f"made again  {what}")
    if done.anew:
        say("a new registry was created")
    say(
        f"{len(done.runs)} runs, {len(done.calibrations)} calibrations, {len(done.models)} models "
        f"and {len(done.certificates)} certificates entered"
    )
    for run_id in done.unfitted:
        say(f"run {run_id} has no model: `torquebench records finish {run_id}` fits and registers")
    for problem in done.problems:
        warn(f"not entered: {problem}")
    if done.anew:
        say("Not in the new registry, because only the old one contained it:")
        for what in NOT_REBUILT:
            say(f"- {what}")
    if done.problems:
        raise typer.Exit(CHECK_FAILED)
