"""Runs a command that sees a folder on a read-only file system; run as a script.

Arguments: the folder, then the command. Permission bits alone prove nothing for root. So root
mounts the folder read-only in a mount namespace of its own, or becomes somebody else where it
may not mount; anybody else takes the write permission away. That nothing can be written is tried
before the command runs.
"""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

NEW_MOUNTS = 0x00020000
PRIVATE_ALL, BIND, READ_ONLY_AGAIN = 0x44000, 0x1000, 0x1021
NOBODY = 65534


def mounted(folder: str) -> bool:
    """Mount a folder read-only where only this process and its children see it."""
    libc = ctypes.CDLL(None, use_errno=True)
    name = folder.encode()
    return all(
        call == 0
        for call in (
            libc.unshare(NEW_MOUNTS),
            libc.mount(b"none", b"/", None, PRIVATE_ALL, None),
            libc.mount(name, name, None, BIND, None),
            libc.mount(name, name, None, READ_ONLY_AGAIN, None),
        )
    )


def main() -> int:
    """Make the folder read-only, try it, run the command."""
    folder, *command = sys.argv[1:]
    if os.getuid() != 0 or not mounted(folder):
        for path in (Path(folder), *Path(folder).rglob("*")):
            path.chmod(path.stat().st_mode & ~0o222 | 0o444)
        if os.getuid() == 0:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
    for attempt in (Path(folder) / "x", next(Path(folder).glob("*.sqlite"))):
        try:
            attempt.open("ab").close()
        except OSError:
            continue
        raise SystemExit(f"{attempt} can be written")
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
