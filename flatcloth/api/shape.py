"""The canonical shape of a garment, and its properties."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from flatcloth.core.errors import FlatclothError, GarmentError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, RotationAxis, Uint8
from flatcloth.engine.headless import ViewDecision
from flatcloth.engine.joints import Alternative, Joint, alternatives, joints_of, with_places
from flatcloth.engine.outcome import lines_of as outcome_lines
from flatcloth.engine.outcome import other_side_lines
from flatcloth.export.data import SessionData, this_from_other
from flatcloth.export.garment import lines_of as garment_lines
from flatcloth.export.garment import named_points
from flatcloth.garments.recognition import Recognition
from flatcloth.grasping.grasps import GraspPose, Grip, grasp_pose, nearest_pixel
from flatcloth.grasping.grips import check_opening_m
from flatcloth.methods.answers import Seam
from flatcloth.session.journal import Pick


@dataclass(frozen=True, eq=False)
class Shape:
    """A canonical shape: the garment as it would lie on a table, with the 3D point of each pixel.

    All arrays are (H, W, ...) numpy arrays on the flattened plane; do not modify them. Points are in the
    object frame: the camera frame of view 0, with every view turned back by its angle (metres, x right,
    y down, z forward).

    Attributes
    ----------
    data : SessionData
        The recording with its decisions, and the files made from them.
    decisions : tuple of ViewDecision
        The decisions about proposed views, in order; those of an earlier, resumed run are not included.
    seconds : mapping
        Wall time of the integration and of the recognition of the garment; empty for an opened session.
    """

    data: SessionData = field(repr=False)
    decisions: tuple[ViewDecision, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def view(self) -> FlattenedView:
        """The shape with all its arrays, pixel size and position on the plane."""
        return self.data.canonical.view

    @property
    def rgb(self) -> Uint8:
        """(H, W, 3) the flat image."""
        return self.view.rgb

    @property
    def valid(self) -> Bool:
        """(H, W) True on cloth."""
        return self.view.valid

    @property
    def xyz_m(self) -> Float32:
        """(H, W, 3) the point of each pixel on the hanging garment, object frame; NaN off the cloth."""
        return self.view.xyz_m

    @property
    def normal(self) -> Float32:
        """(H, W, 3) unit normals out of the cloth, object frame; NaN off the cloth."""
        return self.view.normal

    @property
    def placement_std_m(self) -> Float32 | None:
        """(H, W) standard deviation of each pixel's place on the plane; None with the method ``paper``."""
        return self.view.placement_std_m

    @property
    def pixel_size_m(self) -> float:
        """Size of a pixel on the cloth."""
        return self.view.pixel_size_m

    @property
    def pieces(self) -> tuple[FlattenedView, ...]:
        """Floating pieces: cloth that no view connects to the shape, each on a plane of its own."""
        return self.data.canonical.floating

    @property
    def other(self) -> FlattenedView | None:
        """The other side, as seen from its own outside; None unless both sides were integrated."""
        return None if self.data.joined is None else self.data.joined.other.view

    @property
    def other_pieces(self) -> tuple[FlattenedView, ...]:
        """Floating pieces of the other side."""
        return () if self.data.joined is None else self.data.joined.other.floating

    @property
    def seams(self) -> tuple[Seam, ...]:
        """Where the rims of both sides meet, and whether that joins their pieces."""
        return () if self.data.joined is None else self.data.joined.seams

    @property
    def this_from_other(self) -> Float64 | None:
        """(3, 3) mirror motion from :attr:`other` to this side: (column, row) times the pixel size, and 1.

        None if no seam relates both sides.
        """
        if self.data.joined is None or not self.data.joined.is_related:
            return None
        return this_from_other(self.data.joined.other.view, self.view)

    @property
    def views(self) -> tuple[int, ...]:
        """The views that the shape is made of, sorted."""
        return tuple(sorted(self.data.document.used_views))

    @property
    def axis(self) -> RotationAxis:
        """The turning axis, object frame; estimated if the recording has none."""
        return self.data.integration.axis

    @property
    def report(self) -> dict[str, Any]:
        """The content of ``outcome.json``: views, areas, uncertainty, garment; ready for JSON."""
        return self.data.outcome

    def joints(self) -> list[Joint]:
        """Return where parts of the shape hang on the rest by little evidence, the most doubtful first.

        Empty with the method ``paper``, which weighs no evidence.
        """
        cloth = self.data.integration.cloth(self.data.document)
        found = [] if cloth is None else joints_of(cloth, decisions=self.data.document.garment.parts)
        return found if cloth is None else with_places(found, cloth, self.data.garment)

    def alternatives(self) -> list[Alternative]:
        """Return what the shape may be, with probabilities: as it is, or with a part at another place."""
        return alternatives(self.joints())

    def garment(self) -> Recognition:
        """Return the recognised garment: kind, probabilities, dimensions and named points.

        Raises
        ------
        GarmentError
            If the shape shows too little, or was made of one view.
        """
        known = self.data.garment
        if isinstance(known, str):
            raise GarmentError(known)
        return known.found

    def named_points(self) -> dict[str, Pick]:
        """Return the named points of the garment that either side shows, with position and normal in space.

        Empty if no known kind was recognised.
        """
        return {point.name: point for point in named_points(self.data.garment, self.data.sides)}

    def grasp(
        self, row: int, col: int, *, piece: int | None = None, opening_m: float | None = None
    ) -> GraspPose:
        """Return the pose of a parallel gripper at a pixel of the cloth.

        Parameters
        ----------
        row, col : int
            A pixel of the shape, or of the floating piece with the index ``piece``.
        piece : int, optional
            Index in :attr:`pieces`.
        opening_m : float, optional
            Distance of the fingers, by default 40 mm.

        Returns
        -------
        GraspPose
            In the object frame; ``camera_from_grasp(shape.axis, angle_deg)`` turns it with the item.

        Raises
        ------
        FlatclothError
            If there is no such piece, or the pixel is not on its cloth.
        """
        if piece is not None and not 0 <= piece < len(self.pieces):
            raise FlatclothError(f"piece {piece}: the shape has {len(self.pieces)} floating pieces.")
        view = self.view if piece is None else self.pieces[piece]
        rows, cols = view.shape
        if not (0 <= row < rows and 0 <= col < cols and view.valid[row, col]):
            raise FlatclothError(f"pixel ({row}, {col}): no cloth there; choose one where valid is True.")
        return self._pose(view, (row, col), opening_m)

    def grasp_point(self, name: str, *, opening_m: float | None = None) -> GraspPose:
        """Return the pose of a parallel gripper at a named point of the garment (see :meth:`grasp`).

        Raises
        ------
        GarmentError
            If the garment has no point of this name, or its cloth was not seen.
        """
        point = self.named_points().get(name)
        if point is None:
            seen = ", ".join(self.named_points()) or "none"
            raise GarmentError(f"{name}: no named point of this garment that was seen; seen are {seen}.")
        views = [self.view, *self.pieces] if point.side == "this" or self.other is None else [self.other]
        found = nearest_pixel(views, point.position_held_m)
        assert found is not None, "the cloth of the point was seen"
        return self._pose(views[found[0]], found[1], opening_m)

    def _pose(self, view: FlattenedView, pixel: tuple[int, int], opening_m: float | None) -> GraspPose:
        grip = Grip() if opening_m is None else Grip(opening_m=opening_m)
        check_opening_m(grip.opening_m)
        pose = grasp_pose(view, view.xyz_m[pixel], view.normal[pixel], self.axis, grip, (pixel, 0.0))
        if pose is None:
            raise FlatclothError(f"pixel {pixel}: the cloth has no normal there; choose another pixel.")
        return pose

    def write(
        self, folder: str | os.PathLike[str], *, base_from_camera: Rigid3 | ArrayLike | None = None
    ) -> list[Path]:
        """Write the data files of ``flatcloth run`` (docs/exports.md) to a folder, and return them.

        Those of the other side are written if both sides were integrated.

        Parameters
        ----------
        folder : str or Path
            Created if it is missing. Each file is replaced as a whole.
        base_from_camera : Rigid3 or (4, 4) float, optional
            Hand-eye transform: the grasp poses are then given in the robot's frame too.

        Raises
        ------
        FlatclothError
            If the folder cannot be written.
        """
        data, given = self.data, base_from_camera
        if given is not None and not isinstance(given, Rigid3):
            from flatcloth.grasping.hand_eye import rigid_from_matrix

            given = rigid_from_matrix(given, "the matrix")
        if given is not None:
            data = replace(data, base_from_camera=given)
        return data.write(Path(folder))

    def lines(self) -> list[str]:
        """Return a summary in a few lines of text: views, areas, uncertainty and garment."""
        other = other_side_lines(self.report["other_side"]) if "other_side" in self.report else []
        return [*outcome_lines(self.report), *other, *garment_lines(self.data.garment)]

    def _repr_html_(self) -> str:
        """Return the picture that a notebook shows for a shape."""
        from flatcloth.api.notebook import html_of

        return html_of(self.data, self.named_points(), self.lines())

    def widget(self) -> Any:
        """Return a widget for notebooks: the flat image, on which clicks pick points.

        Returns
        -------
        anywidget.AnyWidget
            Its ``poses`` are the grasp poses (:class:`GraspPose`) of the picks, by name.

        Raises
        ------
        FlatclothError
            If anywidget is not installed.
        """
        from flatcloth.api.notebook import widget_of

        return widget_of(self.data, self.named_points(), self.grasp)

    def __str__(self) -> str:
        return "\n".join(self.lines())
