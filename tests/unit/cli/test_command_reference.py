"""The page of commands names every command of the program."""

import re
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "commands.md"


def test_every_command_is_in_the_reference() -> None:
    from torquebench.cli import whole_command

    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    named = {
        word for row in rows for code in re.findall(r"`([^`]+)`", row) for word in code.split()
    }
    named = {name for word in named for name in re.split(r"[\\|]+", word)}

    def leaves(command: Any, path: list[str]) -> list[list[str]]:
        children = getattr(command, "commands", {})
        if not children:
            return [path]
        return [leaf for name, child in children.items() for leaf in leaves(child, [*path, name])]

    missing = [" ".join(path) for path in leaves(whole_command(), []) if not set(path) <= named]
    assert missing == []
