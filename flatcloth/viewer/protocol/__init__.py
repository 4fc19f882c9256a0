"""The messages between the page and the server.

Input: messages, checked strictly. Output: the state of the page as plain JSON values.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec


class Sent(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The base of everything that is sent to the page."""


def table(text: str) -> Iterator[list[str]]:
    """Yield the cells of a table whose columns are separated by " | "; an indented line goes on."""
    for row in text.replace("\n    ", " ").strip().splitlines():
        yield row.split(" | ")
