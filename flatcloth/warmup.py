"""Compile the numerical kernels once, so that the first start is as quick as the later ones.

``python -m flatcloth.warmup`` runs one small synthetic view through the whole method; numba keeps
what it compiled beside the sources.
"""

from __future__ import annotations
