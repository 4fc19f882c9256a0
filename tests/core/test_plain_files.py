"""Files of somebody else are read only if they are files, and only so much of them."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from flatcloth.core.plain_files import check_replacing, open_plain, read_plain, replace_file


def test_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"cloth")
    assert read_plain(tmp_path / "a") == b"cloth"
    assert read_plain(tmp_path / "a", most_bytes=5) == b"cloth"
    with open_plain(tmp_path / "a") as file:
        assert (file.read(2), file.seek(0), file.read()) == (b"cl", 0, b"cloth")


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a pipe or device"):
        read_plain(tmp_path / "pipe")


def test_a_device_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("/dev/zero")
    with pytest.raises(OSError, match="a pipe or device"):
        open_plain(tmp_path / "link")


def test_a_folder_and_a_missing_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        open_plain(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_plain(tmp_path / "gone")


def test_what_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    path.touch()
    os.truncate(path, 10**12)
    with pytest.raises(OSError, match="larger than 16 MB"):
        read_plain(path)


def test_only_a_file_or_a_link_is_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, cause in (("pipe", "a pipe or device"), ("folder", "a folder")):
        with pytest.raises(OSError, match=cause):
            replace_file(tmp_path / name, b"cloth")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    (tmp_path / "link").symlink_to(tmp_path / "target")
    replace_file(tmp_path / "link", b"cloth")
    assert not (tmp_path / "target").exists()
    assert (tmp_path / "link").read_bytes() == b"cloth"


def test_checking_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"cloth")
    check_replacing(tmp_path / "a")
    check_replacing(tmp_path / "new/b")
    assert (tmp_path / "a").read_bytes() == b"cloth"
    assert list((tmp_path / "new").iterdir()) == []
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        check_replacing(tmp_path / "a/b")


def test_no_file_stays_open(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    before = len(os.listdir("/proc/self/fd"))
    for name in ("pipe", ".", "gone"):
        with pytest.raises(OSError):  # noqa: PT011 - which one is tested above
            open_plain(tmp_path / name)
    assert len(os.listdir("/proc/self/fd")) == before
