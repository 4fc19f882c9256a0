"""The same shape on every processor, whatever the width of its vectors and its BLAS."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.thorough
SHAPE_OF = """
import sys
import numpy as np
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.session.document import Document, accept_all

made = Integration(open_recording(sys.argv[1]))
document = accept_all(Document(start_view=0), range(3, len(made.recording), 3), {})
shape = made.algorithm.shapes.of(document)
np.savez(sys.argv[2], uv_m=shape.all_uv_m, std_m=shape.std_m, piece=shape.piece, holds=shape.holds)
"""
OLD_PROCESSOR = {
    "NUMBA_CPU_NAME": "nehalem",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX2 FMA3",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""A processor without AVX2 and AVX-512."""


def computed(out: Path, more: dict[str, str]) -> dict[str, np.ndarray]:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **more}
    command = [sys.executable, "-c", SHAPE_OF, "trousers-waist-d435", str(out)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with np.load(out) as arrays:
        return dict(arrays)


def test_a_processor_with_narrower_vectors_gives_the_same_shape(tmp_path: Path) -> None:
    here = computed(tmp_path / "here.npz", {})
    old = computed(tmp_path / "old.npz", OLD_PROCESSOR)
    np.testing.assert_array_equal(old["piece"], here["piece"])
    np.testing.assert_array_equal(old["holds"], here["holds"])
    np.testing.assert_allclose(old["uv_m"], here["uv_m"], atol=2e-4, rtol=0)
    np.testing.assert_allclose(old["std_m"], here["std_m"], atol=2e-4, rtol=0)
