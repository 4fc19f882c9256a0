"""``segment`` and ``run`` on a recording without masks, from the command line."""

import dataclasses
import json
import re

import cv2
import numpy as np
import pytest
from plates import TOP_M, plate
from scenes import AXIS, CAMERA

from flatcloth.cli import main
from flatcloth.core.strokes import FORMAT, ImageStroke
from flatcloth.recordings import open_recording
from flatcloth.recordings.writer import DEPTH_SCALE_M, RecordingWriter, depth_units

# No view along the plate: it would show nothing.
VIEWS = plate((0.0, 20.0, 40.0, 60.0, 120.0, 150.0, 180.0, 210.0, 240.0, 300.0, 320.0, 340.0))
BACK = (ImageStroke(side="this", view_index=6, points_rc=((119.0, 119.0),)),)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording") / "plate"
    with RecordingWriter(
        folder,
        name="plate",
        intrinsics=CAMERA,
        depth_scale_m=DEPTH_SCALE_M,
        rotation_axis=AXIS,
        held_point_m=TOP_M,
    ) as writer:
        for view in VIEWS:
            frame = view.frame
            writer.add(frame.angle_deg, frame.color, depth_units(frame.depth_m))
    return folder


def _strokes(tmp_path, decisions=BACK):
    file = tmp_path / "strokes.json"
    tables = [{"kind": "image", **dataclasses.asdict(decision)} for decision in decisions]
    file.write_text(json.dumps({"format": FORMAT, "decisions": tables}))
    return file


def test_segment_writes_a_mask_for_each_view_and_says_how_sure_it_is(recording, tmp_path, capsys):
    assert main(["segment", str(recording), "--out", str(tmp_path / "masks")]) == 0
    masks = [cv2.imread(str(tmp_path / "masks" / f"{n:03d}.png"), cv2.IMREAD_UNCHANGED) for n in range(12)]
    for mask, view in zip(masks, VIEWS, strict=True):
        assert set(np.unique(mask)) <= {0, 255}
        assert not (mask[view.back] > 0).any()
    assert np.array_equal(masks[0] > 0, VIEWS[0].front)
    report = json.loads((tmp_path / "masks" / "segmentation.json").read_text())
    assert report["certainty"] > 0.7
    assert "Side of interest" in capsys.readouterr().out


def test_segment_copies_the_recording_with_masks_after_strokes(recording, tmp_path):
    out = tmp_path / "masked"
    strokes = _strokes(tmp_path)
    assert main(["segment", str(recording), "--out", str(out), "--copy", "--strokes", str(strokes)]) == 0
    made = open_recording(out)
    assert made.has_masks
    assert np.array_equal(made[6].mask, VIEWS[6].back)
    assert not made[0].mask.any()


def test_strokes_that_touch_no_image_are_refused_and_not_journaled(recording, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["run", str(recording), "--out", str(out), "--sides", "one", "--strokes"]
    for view_index, row, cause in (
        (12, 119.0, "view 12 does not exist"),
        (6, -1e4, "outside the image of view 6"),
        (6, 1e5, "outside"),
    ):
        off = (ImageStroke(side="this", view_index=view_index, points_rc=((row, 119.0),)),)
        strokes = str(_strokes(tmp_path, off))
        assert main([*command, strokes, "--quiet"]) == 2
        said = capsys.readouterr().err
        assert cause in said
        assert said.count("\n") == 1
        assert (out / "journal.jsonl").read_bytes() == b""
    assert main([*command, str(_strokes(tmp_path))]) == 0
    outcome = json.loads((out / "outcome.json").read_text())
    assert outcome["segmentation"]["decisions"] == 1
    assert outcome["segmentation"]["certainty"] > 0.7
    # Of 0.14 m by 0.20 m, one side only.
    assert 200 < outcome["area_cm2"] < 300


def decisions(*tables: object) -> str:
    """Return the text of a file of strokes."""
    return json.dumps({"format": FORMAT, "decisions": tables})


ON_IMAGE = {"kind": "image", "side": "this", "view_index": 0, "points_rc": [[119.0, 119.0]]}
ON_CLOTH = {
    "kind": "space", "side": "this", "points_m": [[0.0, 0.0, 0.7]] * 2, "normals": [[0.0, 0.0, -1.0]] * 2,
}  # fmt: skip


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, r"strokes.json: cannot be read \(No such file"),
        ("no json", "not valid JSON"),
        ('{"format": "other"}', 'its "format" must be "flatcloth-strokes/1"'),
        (decisions({"kind": "dab"}), r"decisions\[0\]: no stroke; its kind"),
        (decisions(ON_IMAGE | {"side": "left"}), r"""side is 'left'; expected one of "this" and "other"."""),
        (decisions(ON_IMAGE | {"view_index": 44}), "decision 1: there is no view 44 that shows the item"),
        (decisions(ON_IMAGE | {"points_rc": [[119, 119], [1e300, 0]]}), r"points_rc\[1\]\[0\] is 1e\+300"),
        (decisions(ON_CLOTH | {"normals": [[0, 0, 0]] * 2}), "no cloth under it"),
        (decisions(ON_CLOTH | {"points_m": [[900.0, 0, 0], [900.0, 0, -900.0]]}), "no cloth under it"),
    ],
)  # fmt: skip
def test_strokes_that_are_none_are_told_in_one_line(recording, tmp_path, capsys, content, said):
    file = tmp_path / "strokes.json"
    if content is not None:
        file.write_text(content)
    assert main(["segment", str(recording), "--out", str(tmp_path / "out"), "--strokes", str(file)]) == 2
    error = capsys.readouterr().err.strip()
    assert re.search(said, error)
    assert "\n" not in error
    assert not (tmp_path / "out").exists()
