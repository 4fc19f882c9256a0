"""Everything that can be wrong with a recording folder is one clear line, never a traceback."""

import operator
import os
import struct
import zlib
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_recordings import HEIGHT, WIDTH, header, write_header, write_image, write_recording

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording

CAMERA = header()["intrinsics"] | {"distortion_model": "brown_conrady"}
LARGE = {"width": 16384, "height": 16384, "fx": 20_000.0, "fy": 20_000.0, "distortion_model": "none"}
NAN, INFINITY = float("nan"), float("inf")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "tiny")


def refused(folder: Path, cause: str, file: str = "recording.json") -> str:
    """Open and read everything; return the one-line message, which must name file and cause."""
    with pytest.raises(RecordingError, match=cause) as caught:
        read_everything(folder)
    message = str(caught.value)
    assert message.startswith(str(folder / file) + ": ")
    assert "\n" not in message
    assert message.endswith(".")
    return message


def read_everything(folder: Path) -> None:
    recording = open_recording(folder)
    for view_index in range(len(recording)):
        recording[view_index]


def put(*path: Any) -> Callable[[dict[str, Any]], None]:
    """Return a change of the header: the last argument is the value, those before it the way to it."""
    *way, last, value = path
    return lambda content: operator.setitem(reduce(operator.getitem, way, content), last, value)


def remove(*path: Any) -> Callable[[dict[str, Any]], None]:
    *way, last = path
    return lambda content: operator.delitem(reduce(operator.getitem, way, content), last)


HEADER_FAULTS: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (put("format", "flatcloth-recording/2"), "format flatcloth-recording/2 is unknown"),
    (remove("format"), "format is null"),
    (remove("intrinsics"), "intrinsics is missing"),
    (put("intrinsics", "fx", NAN), "intrinsics.fx is not a finite number"),
    (put("intrinsics", "fx", 0), "intrinsics.fx is 0"),
    (put("intrinsics", "fx", 1e6), "intrinsics.fx is 1e"),
    (put("intrinsics", "fy", 60), "differ too much"),
    (put("intrinsics", "cx", 1e4), "intrinsics.cx is 10000"),
    (put("intrinsics", "width", 0), "intrinsics.width is 0"),
    (put("intrinsics", CAMERA | LARGE), "268 megapixels. The limit is 25"),
    (put("intrinsics", "distortion_model", "mei"), "distortion_model mei is unknown"),
    (put("intrinsics", "distortion", [0.1]), "distortion has numbers, but distortion_model is none"),
    (put("intrinsics", "distortion_model", "brown_conrady"), "distortion has 0 numbers"),
    (put("intrinsics", CAMERA | {"distortion": [0.1] * 6}), "distortion has 6 numbers"),
    (put("intrinsics", CAMERA | {"distortion": [-5.0, 0, 0, 0]}), "distortion folds the image over itself"),
    (put("depth_scale_m", 0), "no depth"),
    (put("depth_scale_m", 1), "depth_scale_m is 1"),
    (put("rotation_axis", "point_m", [0, 0, 850.0]), "more than 100 m away"),
    (put("rotation_axis", "direction", [0, -2, 0]), "direction has length 2"),
    (put("rotation_axis", "direction", [1e308, 1e308, 0]), r"direction\[0\] is 1e\+308"),
    (put("rotation_axis", "direction", [0, 0, 1]), "in which the camera looks"),
    (put("views", []), "views is empty"),
    (put("views", [{"angle_deg": 0}] * 10_001), "10001 views"),
    (put("views", 1, "angle_deg", NAN), r"views\[1\].angle_deg is not a finite number"),
    (put("views", 1, "angle_deg", 1e9), r"views\[1\].angle_deg is 1e"),
    (put("views", 2, "angle_deg", 10.0), r"views\[2\] has the angle of views\[1\]"),
    (put("views", 2, "angle_deg", -350.005), r"views\[2\] has the angle of views\[1\]"),
    (put("views", 2, "angle_deg", 359.995), r"views\[2\] has the angle of views\[0\]"),
    (remove("views", 2, "depth"), r"views\[2\] has no depth image"),
    (put("views", 2, "color", "a\0b"), "printable characters"),
    (put("views", 2, "color", "\ud800"), "printable characters"),
    (put("views", 2, "color", "/etc/hostname"), "inside the folder"),
    (put("views", 2, "color", "../tiny/color/2.png"), "inside the folder"),
    (put("views", 2, "color", "color\\2.png"), "inside the folder"),
    (put("views", 2, "color", "C:/color/2.png"), "inside the folder"),
    (put("views", 2, "truth", "../truth.png"), "inside the folder"),
    (remove("views", 2, "mask"), r"views\[2\] has no mask, but other views have one"),
]


@pytest.mark.parametrize(("change", "cause"), HEADER_FAULTS, ids=[cause for _, cause in HEADER_FAULTS])
def test_a_fault_in_the_header_is_named(
    folder: Path, change: Callable[[dict[str, Any]], None], cause: str
) -> None:
    content = header()
    change(content)
    write_header(folder, content)
    refused(folder, cause)


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", "not valid JSON"),
        (b"{", "not valid JSON"),
        (b'{"format": 1' + b"0" * 5000 + b"}", "not valid JSON"),
        (b"\xff\xfe{}", "not UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[]", "the file is a list of 0"),
        (b"null", "the file is missing"),
        (b" " * 16_000_001, "larger than 16 MB"),
    ],
    ids=["empty", "cut", "digits", "utf-16", "deep", "list", "null", "huge"],
)
def test_a_file_that_is_no_header_is_refused(folder: Path, data: bytes, cause: str) -> None:
    (folder / "recording.json").write_bytes(data)
    refused(folder, cause)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
        max_leaves=5,
    ),
    st.data(),
)
def test_any_value_anywhere_in_the_header_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, value: Any, data: st.DataObject
) -> None:
    folder = write_recording(tmp_path_factory.mktemp("any") / "tiny")
    content = header()
    place: Any = content
    while True:
        key = data.draw(st.sampled_from(list(place) if isinstance(place, dict) else list(range(len(place)))))
        if not isinstance(place[key], dict | list) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = value
    write_header(folder, content)
    complaint = ""
    try:
        recording = open_recording(folder)
    except RecordingError as error:
        complaint = str(error)
    else:
        assert all(np.isfinite(recording.angles_deg))
    assert "\n" not in complaint


# --- images ---------------------------------------------------------------------------------------

GRAY = np.full((HEIGHT, WIDTH), 100, dtype=np.uint8)
COLOR = np.full((HEIGHT, WIDTH, 3), 100, dtype=np.uint8)
DEPTH = np.full((HEIGHT, WIDTH), 850, dtype=np.uint16)
IMAGES = ("color/1.png", "depth/1.png", "mask/1.png")


@pytest.mark.parametrize(
    ("file", "pixels", "cause"),
    [
        ("color/1.png", COLOR[:, :-1], "15x12 px, but the intrinsics are for 16x12"),
        ("color/1.png", np.swapaxes(COLOR, 0, 1), "12x16 px, but the intrinsics are for 16x12"),
        ("color/1.png", GRAY, "8-bit PNG with 1 channel. Color images must be"),
        ("color/1.png", COLOR.astype(np.uint16), "16-bit PNG with 3 channels. Color images must be"),
        ("depth/1.png", DEPTH[:-1], "16x11 px, but the intrinsics are for 16x12"),
        ("depth/1.png", DEPTH.astype(np.uint8), "8-bit PNG with 1 channel. Depth images must be"),
        ("depth/1.png", np.dstack([DEPTH] * 3), "16-bit PNG with 3 channels. Depth images must be"),
        ("depth/1.png", np.zeros_like(DEPTH), "no depth, every pixel is 0"),
        ("mask/1.png", GRAY[1:], "16x11 px, but the intrinsics are for 16x12"),
        ("mask/1.png", DEPTH, "16-bit PNG with 1 channel. Masks must be"),
        ("mask/1.png", COLOR, "8-bit PNG with 3 channels. Masks must be"),
        ("mask/1.png", np.ones_like(GRAY), "the largest value is 1. Mark the side of interest with 255"),
    ],
)
def test_an_image_of_the_wrong_size_or_kind_is_named(
    folder: Path, file: str, pixels: np.ndarray, cause: str
) -> None:
    write_image(folder / file, pixels)
    refused(folder, cause, file)


def flipped(data: bytes) -> bytes:
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :]


def undecodable(data: bytes) -> bytes:
    """Put pixels into it that do not decompress, with right check sums."""
    chunks = [b"IDATnot a compressed stream", b"IEND"]
    packed = [struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks]
    return data[: data.index(b"IDAT") - 4] + b"".join(packed)


def replaced(make: Callable[[Path], object]) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        path.unlink()
        make(path)

    return damage


NO_IMAGES = (b"", b"text", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"\xff\xd8\xff\xe0\0\0")
DAMAGES: list[tuple[str, Callable[[Path], object], str]] = [
    *((file, Path.unlink, "No such file") for file in IMAGES),
    *((file, lambda path, data=data: path.write_bytes(data), "not a readable PNG or JPEG")
      for file in IMAGES for data in NO_IMAGES),
    ("recording.json", replaced(Path.mkdir), "missing"),
    ("depth/1.png", replaced(Path.mkdir), "not a file"),
    ("depth/1.png", replaced(os.mkfifo), "not a file"),
    ("depth/1.png", lambda path: path.write_bytes(flipped(path.read_bytes())), "damaged"),
    ("depth/1.png", lambda path: path.write_bytes(undecodable(path.read_bytes())), "decoded|no depth"),
    ("color/1.png", replaced(lambda path: path.symlink_to(path)), "outside|followed"),
    *((f"{kind}/1.png", lambda path: path.symlink_to(path.rename(path.parents[2] / "outside.png")),
       "outside|followed") for kind in ("color", "depth", "mask", "truth")),
]  # fmt: skip


@pytest.mark.parametrize(("file", "damage", "cause"), DAMAGES)
def test_a_file_that_is_missing_damaged_or_elsewhere_is_named(
    folder: Path, file: str, damage: Callable[[Path], object], cause: str
) -> None:
    damage(folder / file)
    refused(folder, cause, "recording.json" if "outside|followed" in cause else file)


def test_every_truncation_of_an_image_is_noticed(folder: Path) -> None:
    rng = np.random.default_rng(3)
    texture = rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for file, data in (
        ("color/1.png", cv2.imencode(".jpg", texture)[1].tobytes()),
        ("color/1.png", cv2.imencode(".png", texture)[1].tobytes()),
        ("depth/1.png", cv2.imencode(".png", DEPTH + texture[..., 0])[1].tobytes()),
    ):
        path = folder / file
        kept = path.read_bytes()
        for end in range(0, len(data), 7):
            path.write_bytes(data[:end])
            with pytest.raises(RecordingError, match=file):
                open_recording(folder)[1]
        path.write_bytes(kept)


def test_an_image_that_announces_a_giant_is_never_decoded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder / "color" / "1.png"
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 60_000, 60_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    recording = open_recording(folder)
    path.write_bytes(data)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(RecordingError, match="60000x60000 px, but the intrinsics are for 16x12"):
        recording[1]
    with pytest.raises(RecordingError, match="60000x60000 px"):
        open_recording(folder)


@pytest.mark.parametrize("bomb", ["comments", "scans"])
def test_a_jpeg_of_endless_parts_is_refused(folder: Path, bomb: str) -> None:
    content = header()
    content["views"][0]["color"] = "color/0.jpg"
    write_header(folder, content)
    path = folder / "color/0.jpg"
    write_image(path, np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8))
    open_recording(folder)[0]
    data = path.read_bytes()
    comments, scan = b"\xff\xfe\0\2" * 5_000_000, data[data.index(b"\xff\xda") : -2]
    parts = (data[:2], comments, data[2:]) if bomb == "comments" else (data[:-2], scan * 100_000, data[-2:])
    path.write_bytes(b"".join(parts))
    refused(folder, "not a readable PNG or JPEG" if bomb == "comments" else "damaged", "color/0.jpg")


def test_a_message_is_never_flooded_by_the_value(folder: Path) -> None:
    write_header(folder, header() | {"format": "x" * 100_000})
    assert len(refused(folder, "format is")) < len(str(folder)) + 200
