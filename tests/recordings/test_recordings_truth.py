"""The truth of synthetic recordings."""

from pathlib import Path

import numpy as np
import pytest
from tiny_recordings import HEIGHT, WIDTH, header, write_header, write_image, write_recording

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.truth import Truth


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "tiny")


def test_panel_face_and_coordinates_are_decoded(folder: Path) -> None:
    truth = Truth(folder)
    assert (truth.garment, truth.panel_of_interest) == ("towel", 1)
    assert len(truth) == 3
    view = truth[2]
    assert (view.panel[0, 0], view.panel[5, 5], view.panel[9, 5]) == (0, 1, 2)
    assert view.panel.dtype == np.uint8
    assert (bool(view.outer_face[5, 5]), bool(view.outer_face[9, 5])) == (True, False)
    assert view.flat_uv_m.shape == (HEIGHT, WIDTH, 2)
    assert view.flat_uv_m.dtype == np.float32
    np.testing.assert_allclose(view.flat_uv_m[5, 5], [0.5, -0.5], atol=1e-6)
    assert np.isnan(view.flat_uv_m[0, 0]).all()


def test_a_recording_without_truth_says_so(folder: Path) -> None:
    for change in ("header", "view"):
        content = header()
        if change == "header":
            del content["truth"]
        else:
            del content["views"][1]["truth"]
        write_header(folder, content)
        with pytest.raises(RecordingError, match="Only a synthetic recording can be evaluated"):
            Truth(folder)


@pytest.mark.parametrize("truth", [{}, [], "front", {"panel_of_interest": 3}, {"panel_of_interest": True}])
def test_a_truth_that_does_not_name_the_panel_is_refused(folder: Path, truth: object) -> None:
    write_header(folder, {**header(), "truth": truth})
    with pytest.raises(RecordingError, match="panel_of_interest is not 1"):
        Truth(folder)


def test_truth_images_are_checked(folder: Path) -> None:
    truth = Truth(folder)
    (folder / "truth" / "0.png").unlink()
    write_image(folder / "truth" / "1.png", np.ones((HEIGHT, WIDTH), dtype=np.uint16))
    write_image(folder / "truth" / "2.png", np.ones((HEIGHT, WIDTH - 1, 3), dtype=np.uint16))
    for view_index, cause in ((0, "No such file"), (1, "three channels"), (2, "intrinsics are for")):
        with pytest.raises(RecordingError, match=cause):
            truth[view_index]
    with pytest.raises(IndexError):
        truth[3]
