"""Makes ``docs/growth.png``, the paper's Fig. 5 on a recording: the views chosen, and the growth by each.

``python docs/growth.py [RECORDING [PICTURE]]`` from the repository; needs the extra ``export``. The recording
is integrated by ``--method paper`` without an operator. Each column is an accepted view: its image, and the
flattened view renewed with it, in which the cloth that it added is orange.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flatcloth.core.types import Uint8
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.result import at_step
from flatcloth.methods.paper.merging import shows
from flatcloth.recordings import open_recording
from flatcloth.session.document import Document
from flatcloth.session.machine import MemorySession, SessionState

ROOT = Path(__file__).parents[1]
RECORDING = ROOT / "recordings" / "shirt-corner-d435"
COLUMNS = 6
ORANGE = (235, 130, 30)
TINT = 0.45


def main() -> None:
    """Integrate and draw."""
    source = sys.argv[1] if len(sys.argv) > 1 else str(RECORDING)
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs" / "growth.png"
    integration = Integration(open_recording(source), method="paper")
    document = Run(integration, MemorySession(SessionState(len(integration.recording)))).finish().document
    draw(integration, document, out)
    sys.stdout.write(f"{out}: {len(document.accepted) + 1} views of {integration.recording.name}\n")


def draw(integration: Integration, document: Document, out: Path) -> None:
    """Draw the start view and every step."""
    assert document.start_view is not None
    views = [document.start_view, *(a.view_index for a in document.accepted)]
    bands = -(-len(views) // COLUMNS)
    figure = Figure(figsize=(2.1 * COLUMNS, 4.6 * bands), dpi=96, layout="constrained")
    axes = figure.subplots(2 * bands, COLUMNS, squeeze=False)
    for place in axes.ravel():
        place.axis("off")
    pictures = [flattened(integration, document, n) for n in range(len(views))]
    images = [seen(integration, view) for view in views]
    shape, size = (np.max([p.shape[:2] for p in of], axis=0) for of in (pictures, images))
    turn_of = integration.recording.angles_deg
    for n, (view, picture) in enumerate(zip(views, pictures, strict=True)):
        above, below = axes[2 * (n // COLUMNS) : 2 * (n // COLUMNS) + 2, n % COLUMNS]
        turn = (turn_of[view] - turn_of[views[0]] - 180.0) % -360.0 + 180.0
        above.set_title(f"view {view}, {turn:+.0f}°" if n else f"start: view {view}", fontsize=10)
        show(above, images[n], size)
        show(below, picture, shape)
        others = 0 if n == 0 else len(document.accepted[n - 1].also)
        area = integration.canonical(at_step(document, n)).view.area_m2
        text = f"{1e4 * area:.0f} cm²" + (f", {others} more part{'s' * (others > 1)}" if others else "")
        below.set_title(text, fontsize=9)
    figure.savefig(out)


def show(axes: Axes, picture: Uint8, shape: NDArray[np.int64]) -> None:
    """Show a picture in the middle of a field of given size (rows, columns)."""
    rows, cols = picture.shape[:2]
    high, wide = shape
    axes.imshow(picture)
    axes.set_xlim((cols - wide) / 2, (cols + wide) / 2)
    axes.set_ylim((rows + high) / 2, (rows - high) / 2)


def seen(integration: Integration, view_index: int) -> Uint8:
    """Return the side of interest in the image of a view, on white."""
    frame = integration.views.frame(view_index)
    shown = frame.depth_m > 0 if frame.mask is None else frame.mask
    rows, cols = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    picture = np.where(shown[..., None], frame.color, np.uint8(255))
    return np.asarray(picture[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1], dtype=np.uint8)


def flattened(integration: Integration, document: Document, order: int) -> Uint8:
    """Return the flattened view after a step, on white; what the step added is orange."""
    view = integration.canonical(at_step(document, order)).view
    rows, cols = np.nonzero(view.valid)
    color = view.rgb.astype(np.float64)
    if order:
        before = integration.canonical(at_step(document, order - 1)).view
        uv = document.accepted[order - 1].current_from_new.apply(view.uv_from_rc(np.argwhere(view.valid)))
        new = ~shows(before, uv)
        at = rows[new], cols[new]
        color[at] = (1.0 - TINT) * color[at] + TINT * np.array(ORANGE)
    color[~view.valid] = 255.0
    return color[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1].astype(np.uint8)


if __name__ == "__main__":
    main()
