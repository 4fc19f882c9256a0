"""flatcloth's command line, from a checkout: ``python app.py --help``."""

from __future__ import annotations

import sys

from flatcloth.cli import main

if __name__ == "__main__":
    sys.exit(main())
