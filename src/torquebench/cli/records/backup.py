"""`torquebench records backup`, `restore` and `rebuild`: back up and restore records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.message import Message
from torquebench.operations.result import Result

__all__ = ["backup", "rebuild", "restore"]


@dataclass(frozen=True, kw_only=True)
class BackedUp(Result):
    """Result of a backup."""

    runs: int
    known_runs: int
    open_runs: Sequence[str]
    files_copied: int
    outside: Sequence[str]
    problems: Sequence[str]
    chain_end: str

    @property
    def failed(self) -> bool:
        """Whether something couldn't be copied."""
        return bool(self.problems)


@dataclass(frozen=True, kw_only=True)
class RestoredFiles(Result):
    """What was restored, replaced and kept; `aside` has the replaced files."""

    restored: Sequence[str]
    replaced: Sequence[str]
    kept: Sequence[str]
    missing: Sequence[str]
    aside: str | None


@dataclass(frozen=True, kw_only=True)
class RebuiltRegistry(Result):
    """Content of a rebuilt registry; `lost` was in the previous one only, which is `aside`."""

    anew: bool
    mended: Sequence[str]
    aside: str | None
    runs: Sequence[str]
    calibrations: Sequence[str]
    models: Sequence[str]
    certificates: Sequence[str]
    unfitted: Sequence[str]
    problems: Sequence[str]
    lost: Sequence[str]

    @property
    def failed(self) -> bool:
        """Whether something couldn't be entered."""
        return bool(self.problems)


def backup(
    target: Annotated[
        Path,
        typer.Argument(help="A new folder, or an earlier backup, which is brought up to date."),
    ],
    data: DataOption = DEFAULT_DATA,
) -> BackedUp:
    """Copy all records into a folder, even while the bench runs.

    The registry is copied in one consistent state, with all files that it names: runs, models,
    certificates, audit log, accounts of the panel. Sealed runs are copied once. The copy is a data
    directory: `--data` lists, verifies and exports it. Exit code 1 if something is damaged and
    couldn't be copied.
    """
    from torquebench.station.backup import back_up

    with TerminalProgress() as progress:
        done = back_up(data_directory(data), target, progress)
    return BackedUp(
        headline=Message(
            "{runs} run folders and {files} other files copied to {target}, {known} run folders "
            "were there already.",
            done.runs,
            done.files,
            target,
            done.known_runs,
        ),
        remarks=(
            *(
                f"{file} lies outside the data directory and isn't in the backup"
                for file in done.outside
            ),
            *(f"not copied: {problem}" for problem in done.problems),
        ),
        runs=done.runs,
        known_runs=done.known_runs,
        open_runs=done.open_runs,
        files_copied=done.files,
        outside=done.outside,
        problems=done.problems,
        chain_end=str(done.head),
    )


def restore(
    source: Annotated[Path, typer.Argument(help="A backup.")],
    replace: Annotated[
        bool,
        typer.Option(
            "--replace", help="Also restore files that differ; the present ones are kept aside."
        ),
    ] = False,
    data: DataOption = DEFAULT_DATA,
) -> RestoredFiles:
    """Restore missing files from a backup, and with `--replace` damaged ones.

    The backup is compared with its registry first; nothing is restored from a damaged one, or from
    one with links. Nothing is overwritten: without `--replace` the command refuses if files differ;
    with it, the present files are moved to a separate folder. Data newer than the backup are kept.
    Everything is restored, or nothing.
    """
    from torquebench.station.backup import restore as restore_backup

    with TerminalProgress() as progress:
        done = restore_backup(source, data, replace=replace, progress=progress)
    return RestoredFiles(
        headline=Message(
            "{restored} restored, {replaced} replaced, {kept} kept. See `torquebench records "
            "verify`; runs that are newer than the backup are entered by `torquebench records "
            "rebuild`.",
            len(done.restored),
            len(done.replaced),
            len(done.kept),
        ),
        remarks=tuple(f"the backup doesn't have {name}" for name in done.missing),
        restored=done.restored,
        replaced=done.replaced,
        kept=done.kept,
        missing=done.missing,
        aside=None if done.aside is None else str(done.aside),
    )


def rebuild(data: DataOption = DEFAULT_DATA) -> RebuiltRegistry:
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
    return RebuiltRegistry(
        headline=Message(
            "{runs} runs, {calibrations} calibrations, {models} models and {certificates} "
            "certificates entered{anew}.",
            len(done.runs),
            len(done.calibrations),
            len(done.models),
            len(done.certificates),
            " in a new registry" if done.anew else "",
        ),
        remarks=(
            *(
                f"run {run_id} has no model: `torquebench records finish {run_id}` fits it"
                for run_id in done.unfitted
            ),
            *(f"not entered: {problem}" for problem in done.problems),
        ),
        anew=done.anew,
        mended=done.mended,
        aside=None if done.aside is None else str(done.aside),
        runs=done.runs,
        calibrations=done.calibrations,
        models=done.models,
        certificates=done.certificates,
        unfitted=done.unfitted,
        problems=done.problems,
        lost=NOT_REBUILT if done.anew else (),
    )
