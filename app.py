"""flatcloth's command line, from a checkout: ``python app.py --help``."""

from __future__ import annotations

from flatcloth.cli import run_and_exit

if __name__ == "__main__":
    run_and_exit()
