"""Files replaced whole, links followed, devices and pipes written to. Nothing here touches /dev."""

import os
import stat
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import IO

import pytest

from torquebench.atomic_write import (
    atomic_file,
    atomic_folder,
    atomic_path,
    atomic_write,
    is_standard_output,
)
from torquebench.errors import InputError

WRITE = """
import sys
from pathlib import Path
from torquebench.atomic_write import atomic_path, atomic_write
print("before", flush=False)
atomic_write(Path(sys.argv[1]), "content\\n")
with atomic_path(Path(sys.argv[1])) as part:
    part.write_text("through a name\\n")
print("after")
"""
WRITE_AS_A_USER = """
import os, sys
from pathlib import Path
from torquebench.atomic_write import atomic_write
from torquebench.errors import InputError
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
try:
    atomic_write(Path(sys.argv[1]), "new")
except InputError as error:
    print(error)
"""
PRINTED = "before\ncontent\nthrough a name\nafter\n"


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _interrupt(file: Path, stream: IO[bytes]) -> None:
    stream.write(b"half")
    stream.flush()
    assert file.read_text() == "old"
    raise ZeroDivisionError


class TestRegularFiles:
    def test_the_new_content_replaces_the_old_and_nothing_else_stays(self, tmp_path: Path) -> None:
        file = tmp_path / "a.csv"
        atomic_write(file, "old")
        atomic_write(file, b"new\r\n")
        assert file.read_bytes() == b"new\r\n"
        assert _names(tmp_path) == ["a.csv"]

    def test_an_error_leaves_the_old_content(self, tmp_path: Path) -> None:
        file = tmp_path / "a.csv"
        file.write_text("old")
        with atomic_path(tmp_path / "b", ".mf4") as part:
            assert part.suffix == ".mf4"
        (tmp_path / "b").unlink()
        with pytest.raises(ZeroDivisionError), atomic_file(file) as stream:
            _interrupt(file, stream)
        with (
            pytest.raises(ZeroDivisionError),
            atomic_path(file, ".mf4") as part,
            part.open("wb") as stream,
        ):
            _interrupt(file, stream)
        assert file.read_text() == "old"
        assert _names(tmp_path) == ["a.csv"]

    def test_permissions_stay(self, tmp_path: Path) -> None:
        file = tmp_path / "a.csv"
        file.write_text("old")
        file.chmod(0o640)
        atomic_write(file, "new")
        assert stat.S_IMODE(file.stat().st_mode) == 0o640

    def test_a_file_without_write_permission_is_kept(self) -> None:
        """Its folder alone would allow to replace it. Permissions mean nothing to root."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder).chmod(0o777)
            file = Path(folder, "a.csv")
            file.write_text("old")
            file.chmod(0o444)
            done = subprocess.run(
                [sys.executable, "-c", WRITE_AS_A_USER, file],
                check=True,
                capture_output=True,
                text=True,
            )
            assert "Permission denied" in done.stdout
            assert file.read_text() == "old"
            assert _names(Path(folder)) == ["a.csv"]

    def test_a_new_file_is_readable_as_the_user_has_set(self, tmp_path: Path) -> None:
        (tmp_path / "usual").touch()
        atomic_write(tmp_path / "ours", "new")
        assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode

    def test_a_private_file_is_its_owners_alone_from_its_beginning(self, tmp_path: Path) -> None:
        with atomic_file(tmp_path / "key.pem", private=True):
            (part,) = tmp_path.iterdir()
            assert stat.S_IMODE(part.stat().st_mode) == 0o600
        with atomic_path(tmp_path / "raw.parquet", private=True) as part:
            assert stat.S_IMODE(part.stat().st_mode) == 0o600
        assert {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o600}

    def test_a_copy_keeps_the_permissions_that_it_was_given(self, tmp_path: Path) -> None:
        atomic_write(tmp_path / "copy", "old")
        with atomic_path(tmp_path / "copy") as part:
            part.chmod(0o600)
        assert stat.S_IMODE((tmp_path / "copy").stat().st_mode) == 0o600

    def test_a_folder_and_a_missing_folder_are_refused(self, tmp_path: Path) -> None:
        for path in (tmp_path, tmp_path / "none" / "a.csv"):
            with pytest.raises(InputError, match="can't write"):
                atomic_write(path, "x")
        assert _names(tmp_path) == []


class TestFolders:
    def test_a_folder_is_replaced_whole_or_not_at_all(self, tmp_path: Path) -> None:
        folder = tmp_path / "run"
        (tmp_path / ".run.part").mkdir()
        (tmp_path / ".run.part" / "of a killed process").touch()
        with atomic_folder(folder) as part:
            (part / "a").touch()
        assert _names(folder) == ["a"]
        with pytest.raises(FileNotFoundError), atomic_folder(folder) as part:
            (part / "none" / "b").touch()
        assert _names(folder) == ["a"]
        with atomic_folder(folder) as part:
            (part / "c").touch()
        assert _names(folder) == ["c"]
        assert _names(tmp_path) == ["run"]


class TestLinks:
    def test_a_link_stays_and_what_it_leads_to_is_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "folder").mkdir()
        (tmp_path / "folder" / "a.csv").write_text("old")
        (tmp_path / "second").symlink_to("folder/a.csv")
        (tmp_path / "first").symlink_to(tmp_path / "second")
        atomic_write(tmp_path / "first", "new")
        assert (tmp_path / "first").is_symlink()
        assert (tmp_path / "second").is_symlink()
        assert (tmp_path / "folder" / "a.csv").read_text() == "new"

    def test_a_link_that_leads_nowhere_makes_its_file(self, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to("a.csv")
        atomic_write(tmp_path / "link", "new")
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "a.csv").read_text() == "new"

    def test_links_in_a_circle_are_refused(self, tmp_path: Path) -> None:
        (tmp_path / "a").symlink_to("b")
        (tmp_path / "b").symlink_to("a")
        with pytest.raises(InputError, match="can't write"):
            atomic_write(tmp_path / "a", "x")


class TestSpecialFiles:
    @pytest.mark.parametrize("through_link", [False, True])
    def test_a_pipe_is_written_to(self, tmp_path: Path, through_link: bool) -> None:
        pipe = tmp_path / "pipe"
        os.mkfifo(pipe)
        name = pipe
        if through_link:
            name = tmp_path / "link"
            name.symlink_to(pipe)
        read: list[bytes] = []
        reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
        reader.start()
        atomic_write(name, "content")
        reader.join(120.0)
        assert read == [b"content"]
        assert stat.S_ISFIFO(pipe.stat().st_mode)

    def test_a_device_stays_a_device(self, tmp_path: Path) -> None:
        # As root a node of our own, so that a defect can't hurt the machine's; others can't hurt it
        device = tmp_path / "null"
        if os.geteuid() == 0:
            os.mknod(device, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        else:
            device.symlink_to("/dev/null")
        atomic_write(device, "content")
        with atomic_path(device) as part:
            part.write_text("content")
        assert stat.S_ISCHR(device.stat().st_mode)
        assert _names(tmp_path) == ["null"]


class TestStandardOutput:
    def test_its_names(self, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to("/dev/stdout")
        for name in ("-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", str(tmp_path / "link")):
            assert is_standard_output(Path(name))
        for name in ("a.csv", "/dev/stderr", "/dev/fd/2", "/dev/null", str(tmp_path)):
            assert not is_standard_output(Path(name))

    @pytest.mark.parametrize("through_link", [False, True])
    def test_a_pipe_gets_all_in_order(self, tmp_path: Path, through_link: bool) -> None:
        result = subprocess.run(
            [sys.executable, "-c", WRITE, _name(tmp_path, through_link)],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=True,
        )
        assert result.stdout == PRINTED
        assert not (tmp_path / "-").exists()

    @pytest.mark.parametrize("through_link", [False, True])
    def test_a_file_that_is_appended_to_keeps_its_content(
        self, tmp_path: Path, through_link: bool
    ) -> None:
        log = tmp_path / "log"
        log.write_text("earlier\n")
        with log.open("a") as stream:
            subprocess.run(
                [sys.executable, "-c", WRITE, _name(tmp_path, through_link)],
                stdout=stream,
                cwd=tmp_path,
                check=True,
            )
        assert log.read_text() == "earlier\n" + PRINTED

    def test_another_open_descriptor_is_written_to(self) -> None:
        reading, writing = os.pipe()
        atomic_write(Path(f"/proc/self/fd/{writing}"), "content")
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            assert pipe.read() == b"content"


def _name(folder: Path, through_link: bool) -> str:
    """Return a name of standard output: `-`, or a link as /dev/stdout is one."""
    if not through_link:
        return "-"
    (folder / "stdout").symlink_to("/proc/self/fd/1")
    return "stdout"
