"""Heavy work of the page, of which one is done at a time."""

from __future__ import annotations

import threading

ONE_AT_A_TIME = threading.Lock()
"""Held while the other side or an export is computed: each takes some 200 MB. A recording that was closed
may still be computing one, and the next recording waits for it."""
