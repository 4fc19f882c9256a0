"""The Chromium of the system, for benchmarks and tests of the page."""

from __future__ import annotations

import shutil

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
"""Programs that serve. The first has no windows and opens a tab in half the processor's time."""
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
"""Where it is; None if there is none, and Playwright takes its own build."""
