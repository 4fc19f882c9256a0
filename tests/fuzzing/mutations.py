"""What can be wrong with a file: each mutation changes one file of a sample, led by a random generator."""

from __future__ import annotations

import bz2
import json
import os
import random
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import storage_mcap

Mutation = Callable[[Path, random.Random], None]
"""Changes the file in place."""

_SIZES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**62, 2**63, 2**64 - 1)
_ZSTD: Any = vars(storage_mcap)["zstd"]  # where it is depends on Python's version
_SPARSE_BYTES = 5_000_000_000
_OTHERS = (
    b"", b"\0" * 64, b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0", b"\x89PNG\r\n\x1a\n",
    b"\xff\xd8\xff\xe0", b"II*\0\x08\0\0\0", b"v/1\x01\x02\0\0\0", b"\x93NUMPY\x01\0", b"glTF\x02\0\0\0",
    b"ply\nformat binary_little_endian 1.0\n", b"PK\x03\x04", b"{", b"[[[[", b"\xef\xbb\xbf{}",
    b"\xff\xfe{\0}\0",
)  # fmt: skip


# --- bytes -----------------------------------------------------------------------------------


def truncated(path: Path, rng: random.Random) -> None:
    data = path.read_bytes()
    keep = rng.choice([rng.randrange(len(data) + 1), rng.randrange(min(64, len(data)) + 1), len(data) - 1])
    path.write_bytes(data[: max(keep, 0)])


def bits_flipped(path: Path, rng: random.Random) -> None:
    data = bytearray(path.read_bytes())
    if not data:
        return
    reach = rng.choice([64, 512, len(data)])
    for _ in range(rng.choice([1, 1, 2, 8, 64])):
        data[rng.randrange(min(reach, len(data)))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def bytes_replaced(path: Path, rng: random.Random) -> None:
    data = bytearray(path.read_bytes())
    start = rng.randrange(len(data) + 1)
    length = rng.choice([1, 4, 16, 256, len(data)])
    new = rng.choice([b"\0" * length, b"\xff" * length, rng.randbytes(length)])
    data[start : start + length] = new
    path.write_bytes(data)


def bytes_moved(path: Path, rng: random.Random) -> None:
    """Cut a piece, double it, or put it elsewhere."""
    data = path.read_bytes()
    a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    piece, rest = data[a:b], data[:a] + data[b:]
    at = rng.randrange(len(rest) + 1)
    path.write_bytes(rng.choice([rest, data[:b] + piece + data[b:], rest[:at] + piece + rest[at:]]))


def number_poked(path: Path, rng: random.Random) -> None:
    """Write a length or count as hostile programs do."""
    data = bytearray(path.read_bytes())
    width, form = rng.choice([(2, "H"), (4, "I"), (8, "Q")])
    if len(data) < width:
        return
    at = rng.randrange(min(rng.choice([128, len(data)]), len(data) - width + 1))
    value = rng.choice(_SIZES) & (2 ** (8 * width) - 1)
    data[at : at + width] = struct.pack(rng.choice("<>") + form, value)
    path.write_bytes(data)


def of_another_kind(path: Path, rng: random.Random) -> None:
    path.write_bytes(rng.choice(_OTHERS) + rng.randbytes(rng.choice([0, 3, 200])))


def oversized(path: Path, rng: random.Random) -> None:
    """Let it be followed by gigabytes of nothing (a sparse file)."""
    os.truncate(path, rng.choice([_SPARSE_BYTES, path.stat().st_size + 300_000_000]))


# --- the place in the file system ------------------------------------------------------------


def misplaced(path: Path, rng: random.Random) -> None:
    """No file, or something else where the file should be."""
    path.unlink()
    match rng.randrange(7):
        case 0:
            path.mkdir()
        case 1:
            path.symlink_to("/dev/zero")
        case 2:
            path.symlink_to(path.name)  # leads to itself
        case 3:
            path.symlink_to("/etc/passwd")
        case 4:
            os.mkfifo(path)  # whoever opens it waits for ever
        case 5:
            path.symlink_to(path.parent)
        case _:
            pass


# --- JSON ------------------------------------------------------------------------------------


def _hostile_json(rng: random.Random) -> str:
    depth, width = rng.choice([10, 1000, 100_000]), rng.choice([10, 100_000])
    return rng.choice([
        "null", "true", "false", "0", "-0.0", "-1", "1", "2", "1e308", "-1e308", "1e-320", "1e999", "NaN",
        "Infinity", "-Infinity", "9" * 5000, "9" * 30, "0.5", '""', '"x"', '"\\u0000"', '"\\ud800"',
        '"a\\nb\\u001b[2J"', '"../../../../etc/passwd"', '"/etc/passwd"', '"/dev/zero"', '"C:\\\\x"',
        '"."', '".."', '"~/x"', '"con\\u202etxt"', '"' + "x" * width + '"', "{}", "[]", '{"a": 1}',
        "[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth,
        "[" + ",".join(["1"] * width) + "]", "[[1,2],[3]]", "[null,null,null]", '["a","b","c"]',
        "[NaN,0,0]", "[1e300,1e300,1e300]",
    ])  # fmt: skip


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield value, key
        yield from _places(inner)


def _json_changed(content: Any, rng: random.Random) -> str:
    places = list(_places(content))
    if not places or rng.random() < 0.03:
        return _hostile_json(rng)
    marks: dict[str, str] = {}
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        holder, key = rng.choice(places)
        if isinstance(holder, dict) and rng.random() < 0.12:
            holder.pop(key, None)
        elif isinstance(holder, dict) and rng.random() < 0.06:
            holder[rng.choice(["x", "__class__", "", key + " "])] = holder.pop(key, None)
        elif isinstance(holder, list) and rng.random() < 0.15:
            if key < len(holder):
                holder[key : key + 1] = rng.choice([[], [holder[key]] * 2, [holder[key]] * 500])
        elif isinstance(holder, dict) or key < len(holder):
            mark = f"@mark{len(marks)}@"
            marks[mark], holder[key] = _hostile_json(rng), mark
    text = json.dumps(content)
    for mark, hostile in marks.items():
        text = text.replace(f'"{mark}"', hostile)
    return text


def json_hostile(path: Path, rng: random.Random) -> None:
    path.write_text(_json_changed(json.loads(path.read_text()), rng))


def json_line_hostile(path: Path, rng: random.Random) -> None:
    """Change one line of a file with a JSON value a line, or the order of the lines."""
    lines = path.read_text().splitlines()
    n = rng.randrange(len(lines))
    match rng.randrange(8):
        case 0:
            lines.insert(n, lines[rng.randrange(len(lines))])
        case 1:
            del lines[n]
        case 2:
            lines[n] = rng.choice(["", "{}", "[]", "null", "\0", "{" * 5000])
        case _:
            lines[n] = _json_changed(json.loads(lines[n]), rng)
    path.write_text("\n".join(lines) + rng.choice(["\n", "\n", ""]))


# --- text ------------------------------------------------------------------------------------

_WORDS = (
    "", "nan", "inf", "-inf", "1e999", "-1", "0", "1e300", "-1e300", "9" * 400, "0x10", "1_000", "1,5",
    "\0", "\x1b[2J", "\u00b2", "\u0661", "../../etc/passwd", "/etc/passwd", "/dev/zero", "..", "~",
    "C:\\x", "x" * 100_000, "99999999", "2147483648", "1//", "0/0/0", '"',
)  # fmt: skip


def text_hostile(path: Path, rng: random.Random) -> None:
    """Change one word, or a line, of a text file."""
    lines = path.read_bytes().decode(errors="replace").split("\n")
    n = rng.randrange(len(lines))
    match rng.randrange(7):
        case 0:
            lines.insert(n, rng.choice(lines))
        case 1:
            del lines[n]
        case 2:
            lines[n] = rng.choice(_WORDS)
        case 3:
            lines = lines[:n] + [lines[n]] * rng.choice([1000, 30_000]) + lines[n:]
        case _:
            words = lines[n].replace(",", " , ").split(" ")
            words[rng.randrange(len(words))] = rng.choice(_WORDS)
            lines[n] = " ".join(words)
    path.write_text("\n".join(lines), encoding="utf-8", errors="replace")


# --- images that announce more than they have ------------------------------------------------


def png_announcing_much(path: Path, rng: random.Random) -> None:
    """Write another size into the header, with the right check sum."""
    data = bytearray(path.read_bytes())
    if data[:4] != b"\x89PNG":
        return
    width, height = (rng.choice([0, 1, 16, 30_000, 2**31 - 1, 2**32 - 1]) for _ in range(2))
    data[16:24] = struct.pack(">II", width, height)
    data[24:26] = bytes(rng.choice([(8, 2), (16, 0), (8, 6), (16, 6), (1, 0), (8, 3), data[24:26]]))
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    path.write_bytes(data)


def png_with_chunk_bomb(path: Path, rng: random.Random) -> None:
    """Put a text or color profile into it that unpacks to gigabytes."""
    data = path.read_bytes()
    if data[:4] != b"\x89PNG":
        return
    packed = zlib.compress(b"\0" * 200_000_000, 9)
    heads = {b"zTXt": b"a\0\0", b"iCCP": b"a\0\0", b"iTXt": b"a\0\1\0\0\0", b"IDAT": b""}
    kind, head = rng.choice(sorted(heads.items()))
    body = kind + head + packed
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    path.write_bytes(data[:33] + chunk + data[33:])


def jpeg_of_many_segments(path: Path, rng: random.Random) -> None:
    """Put millions of empty comments, or of scans, into it."""
    data = path.read_bytes()
    if data[:2] != b"\xff\xd8":
        return
    scan = data[data.find(b"\xff\xda") : -2]
    match rng.randrange(3):
        case 0:
            path.write_bytes(data[:2] + b"\xff\xfe\0\2" * 12_000_000 + data[2:])
        case 1:
            path.write_bytes(data[:2] + b"\xff" * 20_000_000 + data[2:])
        case _:
            path.write_bytes(data[:-2] + scan * (20_000_000 // max(len(scan), 1)) + data[-2:])


# --- databases and packed chunks -------------------------------------------------------------


def cell_hostile(path: Path, rng: random.Random) -> None:
    """Change a value of a database, whose own structure stays right."""
    base = sqlite3.connect(path)
    try:
        tables = [name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice([t for t in tables if base.execute(f'SELECT count(*) FROM "{t}"').fetchone()[0]])
        columns = [row[1] for row in base.execute(f'PRAGMA table_info("{table}")')]
        column = rng.choice(columns)
        rows = [row for (row,) in base.execute(f'SELECT rowid FROM "{table}" LIMIT 400')]
        row = rng.choice(rows)
        (value,) = base.execute(f'SELECT "{column}" FROM "{table}" WHERE rowid = ?', (row,)).fetchone()
        where = rng.choice(["WHERE rowid = ?", "WHERE rowid >= ?"])
        change = f'UPDATE OR IGNORE "{table}" SET "{column}" = ? {where}'
        base.execute(change, (_hostile_cell(value, rng), row))
        base.commit()
    finally:
        base.close()


def _hostile_cell(value: object, rng: random.Random) -> object:
    if isinstance(value, bytes) and value and rng.random() < 0.8:
        data = bytearray(value)
        match rng.randrange(3):
            case 0:
                return bytes(data[: rng.randrange(len(data))])
            case 1:
                at = rng.randrange(min(200, len(data)))
                data[at : at + 4] = struct.pack("<I", rng.choice(_SIZES) & 0xFFFFFFFF)
            case _:
                data[rng.randrange(min(200, len(data)))] ^= 1 << rng.randrange(8)
        return bytes(data)
    if isinstance(value, int) and rng.random() < 0.8:
        return rng.choice([0, -1, 1, value + 1, 2**31, 2**62, -(2**62)])
    topic = "/device_0/sensor_0/Depth_0/image/data"
    return rng.choice([None, "", "x", topic, b"", b"\0" * 100, 10**9, -1, 1.5])


def packed_bomb(path: Path, rng: random.Random) -> None:
    """Let the first packed chunk of a ROS 1 bag unpack to gigabytes."""
    data = path.read_bytes()
    at = data.find(b"BZh9")
    if at < 0:
        return
    piece = bz2.compress(b"\0" * 45_000_000)
    (size,) = struct.unpack("<I", data[at - 4 : at])
    bomb = piece * (size // len(piece))
    path.write_bytes(data[:at] + bomb + data[at + len(bomb) :])


def mcap_bomb(path: Path, rng: random.Random) -> None:
    """Let the first packed chunk of an MCAP file unpack to gigabytes."""
    data = path.read_bytes()
    at = data.find(b"\x28\xb5\x2f\xfd")
    if at < 8:
        return
    (size,) = struct.unpack("<Q", data[at - 8 : at])
    piece = _ZSTD.compress(b"\0" * 200_000_000)
    bomb = piece * ((size - 8) // len(piece))
    rest = size - len(bomb) - 8
    bomb += struct.pack("<II", 0x184D2A50, rest) + bytes(rest)  # a frame that is skipped
    path.write_bytes(data[:at] + bomb + data[at + size :])


def zip_bomb(path: Path, rng: random.Random) -> None:
    """Let an array of an archive unpack to gigabytes."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice(sorted(parts))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for other, part in parts.items():
            if other != name:
                archive.writestr(other, part)
        with archive.open(name, "w", force_zip64=True) as file:
            shape = rng.choice(["(3000000000,)", "(50000, 60000)", "(2147483648, 2147483648)", "(-1,)"])
            header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
            file.write(b"\x93NUMPY\x01\0v\0" + header.encode())
            for _ in range(rng.choice([1, 60])):
                file.write(b"\0" * 50_000_000)


BYTES: tuple[Mutation, ...] = (
    truncated, truncated, bits_flipped, bits_flipped, bits_flipped, bytes_replaced, bytes_moved,
    number_poked, number_poked, of_another_kind, misplaced, oversized,
)  # fmt: skip
BY_SUFFIX: dict[str, tuple[Mutation, ...]] = {
    ".json": (json_hostile,) * 16,
    ".jsonl": (json_line_hostile,) * 16,
    ".txt": (text_hostile,) * 10,
    ".csv": (text_hostile,) * 10,
    ".obj": (text_hostile,) * 10,
    ".mtl": (text_hostile,) * 10,
    ".yaml": (text_hostile,) * 10,
    ".ply": (text_hostile,) * 4,
    ".db3": (cell_hostile,) * 16,
    ".bag": (packed_bomb,) * 2,
    ".mcap": (mcap_bomb,) * 2,
    ".npz": (zip_bomb,) * 2,
    ".png": (png_announcing_much, png_announcing_much, png_with_chunk_bomb),
    ".jpg": (jpeg_of_many_segments, jpeg_of_many_segments),
}


def mutated(path: Path, rng: random.Random) -> str:
    """Change a file in one or two ways; return their names."""
    done = []
    for _ in range(rng.choice([1, 1, 1, 2])):
        if not path.is_file() or path.is_symlink():
            break
        change = rng.choice(BYTES + BY_SUFFIX.get(path.suffix, ()))
        try:
            change(path, rng)
        except (
            ValueError,
            KeyError,
            TypeError,
            IndexError,
            RecursionError,
            sqlite3.Error,
            zipfile.BadZipFile,
        ):  # what it changes is no longer there
            bits_flipped(path, rng)
        done.append(change.__name__)
        if path.exists() and path.is_file() and path.stat().st_size > 10**8:
            break
    return "+".join(done)
