"""Decompression of Marc Lehmann's LZF, which PCD files use."""

from __future__ import annotations

from numba import njit

from flatcloth.core.types import Uint8


@njit(cache=True)
def unpack_lzf(data: Uint8, out: Uint8) -> bool:
    """Unpack LZF data into ``out``; return False if they do not fill it exactly."""
    at, to, end, size = 0, 0, data.size, out.size
    while at < end:
        control = int(data[at])
        at += 1
        if control < 32:  # literals
            length = control + 1
            if at + length > end or to + length > size:
                return False
            for _ in range(length):
                out[to] = data[at]
                to += 1
                at += 1
        else:  # back reference: repeat earlier output
            length = control >> 5
            if length == 7:
                if at >= end:
                    return False
                length += int(data[at])
                at += 1
            if at >= end:
                return False
            back = to - ((control & 31) << 8) - int(data[at]) - 1
            at += 1
            length += 2
            if back < 0 or to + length > size:
                return False
            for _ in range(length):
                out[to] = out[back]
                to += 1
                back += 1
    return to == size
