"""Files of somebody else are read only if they are files, and only so much of them."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from flatcloth.core.plain_files import check_replacing, read_plain, replace_file


def sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, 10**12)


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (os.mkfifo, OSError, "a pipe or device"),
        (lambda path: path.symlink_to("/dev/zero"), OSError, "a pipe or device"),
        (sparse, OSError, "larger than 16 MB"),
        (Path.mkdir, IsADirectoryError, "a folder, not a file"),
        (lambda _: None, FileNotFoundError, "No such file"),
    ],
    ids=["pipe", "device without end", "too large", "folder", "missing"],
)
def test_what_is_no_file_to_read_is_refused_at_once_and_does_not_stay_open(
    tmp_path: Path, make: Callable[[Path], None], error: type[OSError], said: str
) -> None:
    make(tmp_path / "made")
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(error, match=said):
        read_plain(tmp_path / "made")
    assert len(os.listdir("/proc/self/fd")) == before


def test_only_a_file_or_a_link_is_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, cause in (("pipe", "a pipe or device"), ("folder", "a folder")):
        with pytest.raises(OSError, match=cause):
            replace_file(tmp_path / name, b"cloth")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    (tmp_path / "target").write_text("precious\n")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    replace_file(tmp_path / "link", b"cloth")
    assert not (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "precious\n"
    assert (tmp_path / "link").read_bytes() == b"cloth"


def test_checking_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"cloth")
    check_replacing(tmp_path / "a")
    check_replacing(tmp_path / "new/b")
    assert (tmp_path / "a").read_bytes() == b"cloth"
    assert list((tmp_path / "new").iterdir()) == []
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        check_replacing(tmp_path / "a/b")
