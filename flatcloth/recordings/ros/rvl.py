"""Decompression of RVL, which ``compressed_depth_image_transport`` offers beside PNG [1].

References
----------
.. [1] A. D. Wilson, "Fast lossless depth image compression", ISS 2017. DOI 10.1145/3132272.3134144
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_LONGEST_BITS = 30
"""Longest number, in bits. By definition of the format, whose numbers are of 32 bits."""


@njit(cache=True)
def unpack_rvl(words: NDArray[np.uint32], out: NDArray[np.uint16]) -> bool:
    """Unpack RVL data into ``out``, which is zero; return False if they end early or do not fit.

    Runs of zeros and of other values alternate; of the latter, the differences are stored.
    """
    at, to, value = 0, 0, 0
    while to < out.size:
        zeros, at = _number(words, at)
        to += zeros
        count, at = _number(words, at)
        if at < 0 or to + count > out.size:
            return False
        for _ in range(count):
            code, at = _number(words, at)
            value += (code >> 1) ^ -(code & 1)  # the sign is the lowest bit
            if at < 0 or not 0 < value < 65536:
                return False
            out[to] = value
            to += 1
    return True


@njit(cache=True)
def _number(words: NDArray[np.uint32], at: int) -> tuple[int, int]:
    """Read a number of three bits a nibble, the lowest first; return it, and where the next begins (-1 none).

    ``at`` counts nibbles, of which each word has eight, the highest first.
    """
    number, bits = 0, 0
    while 0 <= at < 8 * words.size and bits <= _LONGEST_BITS:
        nibble = (words[at >> 3] >> (28 - 4 * (at & 7))) & 15
        at += 1
        number |= (nibble & 7) << bits
        bits += 3
        if nibble < 8:
            return number, at
    return 0, -1
