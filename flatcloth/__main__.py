"""``python -m flatcloth``: the command line."""

from flatcloth.cli import run_and_exit

if __name__ == "__main__":
    run_and_exit()
