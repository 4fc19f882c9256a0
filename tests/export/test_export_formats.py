"""Files for other tools, read back by those tools' own libraries with the numbers that were written."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pycocotools.coco import COCO

from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import FlattenedView
from flatcloth.export.coco import HIDDEN, VISIBLE, write_coco
from flatcloth.export.moments import write_mcap, write_rrd
from flatcloth.export.session import OpenedSession


def cloth(session: OpenedSession) -> FlattenedView:
    return session.growth.view


def turn(session: OpenedSession, order: int) -> Rigid3:
    """The pose of the item before the camera as a view joined the shape."""
    return camera_from_object(session.integration.axis, session.growth.steps[order].angle_deg)


def test_foxglove_s_library_reads_the_views_the_cloud_and_the_picks(
    session: OpenedSession, tmp_path: Path
) -> None:
    path = tmp_path / "session.mcap"
    write_mcap(session, path)
    read: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            read.setdefault(channel.topic, []).append((message.log_time, decoded))
    steps = session.growth.steps
    assert {topic: len(messages) for topic, messages in read.items()} == dict.fromkeys(
        ("/tf", "/camera/calibration", "/camera/color", "/shape/cloud", "/shape/image", "/points"), len(steps)
    )
    times = [time for time, _ in read["/tf"]]
    assert np.diff(times).tolist() == [1_000_000_000] * (len(steps) - 1)

    cloud = read["/shape/cloud"][-1][1]
    assert cloud.frame_id == "object"
    points = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
    at = {field.name: field.offset for field in cloud.fields}
    xyz = points[:, at["x"] : at["x"] + 12].copy().view("<f4")
    view = cloth(session)
    np.testing.assert_array_equal(xyz, view.xyz_m[view.valid])
    np.testing.assert_array_equal(points[:, at["red"] : at["red"] + 3], view.rgb[view.valid])

    for order in range(len(steps)):
        frames = {each.child_frame_id: each for each in read["/tf"][order][1].transforms}
        shift = frames["object"].translation
        np.testing.assert_allclose([shift.x, shift.y, shift.z], turn(session, order).translation_m, atol=1e-9)
    positions = [[p.position.x, p.position.y, p.position.z] for p in read["/points"][0][1].poses]
    np.testing.assert_allclose(positions[0], session.history.picks[0].position_held_m, atol=1e-9)
    flat = decoded_png(read["/shape/image"][-1][1].data)
    np.testing.assert_array_equal(flat[..., 3] > 0, view.valid)


def test_rerun_s_library_reads_the_cloud_the_views_and_the_angles(
    session: OpenedSession, tmp_path: Path
) -> None:
    from rerun.chunk import RrdReader

    path = tmp_path / "session.rrd"
    write_rrd(session, path)
    found: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(str(path)).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        entity = found.setdefault(chunk.entity_path, {})
        for name in set(batch.column_names) - {"log_time", "log_tick"}:
            entity.setdefault(name, []).extend(batch.column(name).to_pylist())
    steps = session.growth.steps
    angles = found["/angle_deg"]
    assert angles["step"] == list(range(len(steps)))
    assert angles["angle"] == [round(1000 * step.angle_deg) for step in steps]
    cloud = found["/camera/object/cloud"]
    view = cloth(session)
    positions = np.array(cloud["Points3D:positions"][-1], dtype=np.float32)
    np.testing.assert_array_equal(positions, view.xyz_m[view.valid])
    in_camera = np.array(found["/points_in_camera"]["Points3D:positions"][1])
    held = np.array([pick.position_held_m for pick in session.history.picks])
    np.testing.assert_allclose(in_camera[: len(held)], turn(session, 1).apply(held), atol=1e-6)
    depth = found["/camera/image/depth"]["EncodedDepthImage:blob"][0]
    stored = decoded_png(bytes(np.array(depth, dtype=np.uint8).ravel()))
    frame = session.integration.recording[steps[0].view_index]
    np.testing.assert_allclose(stored / 10_000, frame.depth_m, atol=0.00006)


def decoded_png(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


# pycocotools speaks to numpy as before version 2.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_coco_s_library_reads_the_named_points_where_the_images_show_them(
    session: OpenedSession, tmp_path: Path
) -> None:
    result = tmp_path / "batch" / "cylinder"
    session.data.write(result)
    for name in ("session.json", "journal.jsonl"):
        (result / name).write_bytes((session.history.folder / name).read_bytes())
    place_points(result, session)
    out = tmp_path / "coco"
    assert write_coco([tmp_path / "batch", result], out) == (1, 4)
    data = COCO(str(out / "annotations.json"))
    (category,) = data.loadCats(data.getCatIds(["towel"]))
    middle = category["keypoints"].index(POINT)
    axis, camera = session.integration.axis, session.integration.recording.intrinsics
    held = session.history.picks[0].position_held_m
    flags = []
    for image in data.loadImgs(data.getImgIds()):
        assert (out / image["file_name"]).is_file()
        (annotation,) = data.loadAnns(data.getAnnIds(image["id"], category["id"]))
        col, row, flag = annotation["keypoints"][3 * middle : 3 * middle + 3]
        x, y, z = camera_from_object(axis, image["angle_deg"]).apply(held)
        assert col == pytest.approx(camera.fx * x / z + camera.cx, abs=0.01)
        assert row == pytest.approx(camera.fy * y / z + camera.cy, abs=0.01)
        flags.append(flag)
        mask = session.integration.recording[image["view_index"]].mask
        overlap = data.annToMask(annotation).astype(bool) & mask
        assert overlap.sum() > 0.97 * mask.sum()
        assert annotation["area"] == mask.sum()
    assert set(flags) <= {HIDDEN, VISIBLE}
    assert VISIBLE in flags


POINT = "corner_1"


def place_points(result: Path, session: OpenedSession) -> None:
    """Call the cylinder a towel, with its first pick as a named point."""
    document = json.loads((result / "garment.json").read_text())
    pick = session.history.picks[0]
    point = {
        "uv_m": [0.0, 0.0], "std_m": 0.01, "seen": True, "held": False, "side": "this",
        "xyz_m": pick.position_held_m.tolist(), "normal": pick.normal_held.tolist(),
        "view_index": 0, "source_rc": [0.0, 0.0],
    }  # fmt: skip
    document |= {"kind": "towel", "points": {POINT: point}}
    (result / "garment.json").write_text(json.dumps(document))
