"""Live cameras: a RealSense camera, or a recorded file that is played in its place."""

from __future__ import annotations

from pathlib import Path

from flatcloth.cameras.base import Camera, CameraEndedError, CameraError, CameraFrame

__all__ = ["Camera", "CameraEndedError", "CameraError", "CameraFrame", "open_camera"]


def open_camera(which: str = "", align: str = "depth") -> Camera:
    """Open a camera.

    Parameters
    ----------
    which : str
        The serial number of a RealSense camera, or empty if only one is connected; or the path of a
        RealSense file, which is then played in place of a camera.
    align : str
        ``depth`` or ``color``: the camera whose pixels are kept.

    Raises
    ------
    CameraError
        If there is no such camera, or it cannot be started.
    RecordingError
        If the file cannot be played.
    """
    if Path(which).suffix.lower() in (".db3", ".bag"):
        from flatcloth.cameras.playback import PlaybackCamera

        return PlaybackCamera(Path(which).expanduser(), align)
    from flatcloth.cameras.realsense import RealsenseCamera

    return RealsenseCamera(which, align)
