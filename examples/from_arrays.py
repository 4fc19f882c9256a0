"""Integrate numpy arrays, and print where to grasp the garment.

python examples/from_arrays.py [RECORDING]
"""

import sys

import numpy as np

import flatcloth


def few(recording: flatcloth.Recording, step: int = 3) -> flatcloth.Recording:
    """Return every third view as a recording of arrays, as a program with a camera of its own makes it."""
    frames = [recording[n] for n in range(0, len(recording), step)]
    camera = recording.intrinsics
    return flatcloth.recording_from_arrays(
        color=[frame.color for frame in frames],  # (H, W, 3) uint8, RGB
        depth=[frame.depth_m for frame in frames],  # (H, W) float, metres; or uint16, millimetres
        intrinsics=np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]),
        angles_deg=[frame.angle_deg for frame in frames],
        masks=[frame.mask for frame in frames] if recording.has_masks else None,
        rotation_axis=recording.rotation_axis,
    )


if __name__ == "__main__":
    recording = few(flatcloth.open_recording(sys.argv[1] if sys.argv[1:] else "shirt-sleeve-clean"))
    shape = flatcloth.integrate(recording, on_view=lambda view, _: print(f"view {view.view_index}", end=" "))
    print(f"\n{shape}")
    for name in shape.named_points():
        pose = shape.grasp_point(name).camera_from_grasp(shape.axis, recording.angles_deg[-1])
        print(f"{name}: {np.round(pose.translation_m, 3)} m, approach {np.round(pose.rotation[:, 2], 2)}")
