"""Heavy work of the page, of which one is done at a time."""

from __future__ import annotations

import threading

ONE_AT_A_TIME = threading.Lock()
"""The other side and the exports, which need it, wait for one another, also for those of a recording that was
closed and are being cancelled: each takes some 200 MB."""
