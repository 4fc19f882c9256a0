"""What can be wrong with a file: each mutation changes one file of a sample, led by a random generator."""

import bz2
import contextlib
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
    """Put something hostile in the place of a value, or leave it out, or repeat it."""
    places = list(_places(content))
    if not places or rng.random() < 0.03:
        return _hostile_json(rng)
    holder, key = rng.choice(places)
    if isinstance(holder, dict) and rng.random() < 0.2:
        value = holder.pop(key)
        if rng.random() < 0.3:
            holder[rng.choice(["x", "__class__", "", key + " "])] = value
    elif isinstance(holder, list) and rng.random() < 0.2:
        holder[key : key + 1] = [holder[key]] * rng.choice([0, 2, 500])
    else:
        holder[key] = "@mark@"
    return json.dumps(content).replace('"@mark@"', _hostile_json(rng))


def json_hostile(path: Path, rng: random.Random) -> None:
    """Change a value of a JSON file, or of one line where each is a value of its own, or a line."""
    if path.suffix == ".json":
        path.write_text(_json_changed(json.loads(path.read_text()), rng))
        return
    lines = path.read_text().splitlines()
    n = rng.randrange(len(lines))
    others = [[], [lines[n]] * 2, [""], ["{}"], ["null"], ["\0"], ["{" * 5000]]
    changed = [_json_changed(json.loads(lines[n]), rng)]
    lines[n : n + 1] = rng.choice([*others, *[changed] * 10])
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


# --- what unpacks to gigabytes ----------------------------------------------------------------


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


def cell_hostile(path: Path, rng: random.Random) -> None:
    """Change a value of a database, whose own structure stays right."""
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        tables = [name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice([t for t in tables if base.execute(f'SELECT count(*) FROM "{t}"').fetchone()[0]])
        column = rng.choice([row[1] for row in base.execute(f'PRAGMA table_info("{table}")')])
        row = rng.choice([row for (row,) in base.execute(f'SELECT rowid FROM "{table}" LIMIT 400')])
        (value,) = base.execute(f'SELECT "{column}" FROM "{table}" WHERE rowid = ?', (row,)).fetchone()
        hostile = [None, "", "x", b"\0" * 100, 0, -1, 1.5, 10**9, 2**62, -(2**62)]
        if isinstance(value, bytes) and value:
            at = rng.randrange(min(200, len(value)))
            number = struct.pack("<I", rng.choice(_SIZES) & 0xFFFFFFFF)
            hostile += [value[: rng.randrange(len(value))], value[:at] + number + value[at + 4 :]] * 10
        where = rng.choice(["=", ">="])
        change = f'UPDATE OR IGNORE "{table}" SET "{column}" = ? WHERE rowid {where} ?'
        base.execute(change, (rng.choice(hostile), row))


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
    truncated, truncated, bits_flipped, bits_flipped, bits_flipped, bytes_replaced,
    number_poked, number_poked, of_another_kind, misplaced, oversized,
)  # fmt: skip
BY_SUFFIX: dict[str, tuple[Mutation, ...]] = {
    ".json": (json_hostile,) * 16,
    ".jsonl": (json_hostile,) * 16,
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
    ".png": (png_with_chunk_bomb,),
}


def mutated(path: Path, rng: random.Random) -> str:
    """Change a file in a way; return its name."""
    change = rng.choice(BYTES + BY_SUFFIX.get(path.suffix, ()))
    try:
        change(path, rng)
    except (ValueError, KeyError, TypeError, IndexError, RecursionError, sqlite3.Error, zipfile.BadZipFile):
        change = bits_flipped  # what it changes is not there
        change(path, rng)
    return change.__name__
