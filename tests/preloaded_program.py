"""Imported by the process that programs are forked from: the page's libraries, and the compiled kernels."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does, before numpy is imported

import flatcloth.commands.output
import flatcloth.viewer.server.app
import flatcloth.viewer.server.workspace  # noqa: F401
from flatcloth.engine.warmup import compile_share

compile_share(0, 1)
