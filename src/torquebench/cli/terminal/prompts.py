"""Answer the bench's questions at the terminal."""

from __future__ import annotations

import contextlib
import select
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torquebench.bench.prompts import Prompt, PromptQueue
    from torquebench.cli.terminal.progress import TerminalProgress

POLL_S = 0.2
"""Interval at which a question is checked for an answer from another interface, s."""


@contextlib.contextmanager
def answering(prompts: PromptQueue, progress: TerminalProgress, *, yes: bool) -> Iterator[None]:
    """Answer the questions of a queue until the block ends.

    Parameters
    ----------
    prompts : PromptQueue
    progress : TerminalProgress
        Progress bars, which pause during a question.
    yes : bool
        Whether to confirm everything without asking.
    """

    def ask(prompt: Prompt) -> None:
        if yes:
            progress.say(f"{prompt.text} (confirmed by --yes)")
            prompts.answer(prompt.number, done=True, who="--yes")
        elif not sys.stdin.isatty():
            prompts.answer(prompt.number, done=False, who="nobody is at the terminal to confirm:")
        else:
            _ask_at_terminal(prompts, prompt, progress)

    with prompts.watching(ask):
        yield


def _ask_at_terminal(prompts: PromptQueue, prompt: Prompt, progress: TerminalProgress) -> None:
    from torquebench.records.signatures import operator_name

    progress.pause()
    answered = False
    try:
        sys.stderr.write(f"{prompt.text} [d]one or [a]bort? ")
        sys.stderr.flush()
        while prompts.pending == prompt:
            if sys.platform != "win32" and not select.select([sys.stdin], [], [], POLL_S)[0]:
                continue
            answer = sys.stdin.readline()
            answered = bool(answer)
            word = answer.strip().lower()
            if word in ("d", "done", "y", "yes"):
                prompts.answer(prompt.number, done=True, who=operator_name())
                return
            if not answer or word in ("a", "abort", "n", "no"):
                prompts.answer(prompt.number, done=False, who=operator_name())
                return
            sys.stderr.write("[d]one or [a]bort? ")
            sys.stderr.flush()
        sys.stderr.write("answered elsewhere\n")
    finally:
        progress.resume(answered=answered)
