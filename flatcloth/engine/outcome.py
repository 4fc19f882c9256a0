"""The report of an integration: which views were accepted or left out, and why."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.checking.result import told
from flatcloth.core.decoding import decoded
from flatcloth.core.plain_files import read_plain
from flatcloth.core.types import FlattenedView, finite
from flatcloth.engine.integration import Integration
from flatcloth.engine.joints import Joint, alternatives, joints_of
from flatcloth.engine.result import pixel_counts, uncertainty
from flatcloth.engine.segmenting import summary
from flatcloth.engine.sheet import OTHER_FILE, SheetPiece, floating_file, other_floating_file, sheet_of
from flatcloth.methods.answers import JoinedSides, OtherJoint, Seam
from flatcloth.registration.registered import describe
from flatcloth.session.document import Accepted, Document
from flatcloth.shape.joints import NEGLIGIBLE

FORMAT = "flatcloth-outcome/1"
FILE = "outcome.json"


def outcome_of(
    integration: Integration,
    document: Document,
    shape: FlattenedView | None = None,
) -> dict[str, Any]:
    """Return the report, ready for JSON: areas in cm2, lengths in mm, angles in degrees.

    Parameters
    ----------
    integration : Integration
        The integration.
    document : Document
        The decisions, of an operator or of an unattended run.
    shape : FlattenedView, optional
        The shape as it is written, with placed pieces; by default the canonical view.
    """
    canonical, cloth = integration.canonical(document), integration.cloth(document)
    shape = canonical.view if shape is None else shape
    joints = [] if cloth is None else joints_of(cloth, decisions=document.garment.parts)
    pieces = sheet_of(canonical, document).pieces
    angles, masks = integration.recording.angles_deg, integration.views.masks
    accepted = [
        _accepted(added, angles[added.view_index], integration.accept_score) for added in document.accepted
    ]
    refused = {r.view_index: r.reason for r in document.rejected}
    skipped = {s.view_index: "skipped" for s in document.skipped}
    left = [
        {"view_index": view, "angle_deg": angles[view], "reason": reason}
        for view, reason in {**refused, **skipped}.items()
    ]
    return {
        "format": FORMAT,
        "recording": integration.recording.name,
        "method": integration.method,
        "start_view": document.start_view,
        "accepted": accepted,
        "left": left,
        "ended": document.finished or "",
        "wrong": integration.wrong(document),
        "area_cm2": round(1e4 * shape.area_m2, 1),
        "floating_cm2": [round(1e4 * piece.view.area_m2, 1) for piece in pieces if piece.placed is None],
        "floating": [_floating(piece) for piece in pieces],
        **uncertainty(shape),
        "joints": [
            {**_joint(each, shape.area_m2), "views": [held.view_index for held in each.views]}
            for each in joints
        ],
        "alternatives": [
            {
                "probability": finite(round(each.probability, 4)),
                "false_joint": next((n for n, joint in enumerate(joints) if joint is each.joint), None),
            }
            for each in alternatives(joints)
        ],
        "pixels": pixel_counts(integration, document),
        **_cameras(integration, document),
        **({} if masks is None else {"segmentation": summary(masks)}),
    }


def _accepted(added: Accepted, angle_deg: float, limit: float) -> dict[str, Any]:
    """Return an accepted view; ``flagged``: its score is below what is accepted without an operator."""
    score = None if added.score is None else finite(round(added.score, 4))
    return {
        "view_index": added.view_index,
        "angle_deg": angle_deg,
        "score": score,
        "by_hand": added.fixed,
        "flagged": score is not None and score < limit,
    }


def _floating(piece: SheetPiece) -> dict[str, Any]:
    """Return a floating piece as it is called on the page, with its file."""
    return {
        "piece": piece.label,
        "file": floating_file(piece.number),
        "area_cm2": round(1e4 * piece.view.area_m2, 1),
        "reason": piece.reason,
        "views": list(piece.views),
    }


def _joint(joint: Joint | OtherJoint, area_m2: float) -> dict[str, Any]:
    return {
        "area_cm2": round(1e4 * joint.share * area_m2, 1),
        "share": round(float(joint.share), 4),
        "probability": round(joint.probability, 4),
        "evidence": round(joint.evidence, 2),
    }


def _cameras(integration: Integration, document: Document) -> dict[str, Any]:
    """Return the results of the registration of the cameras, if the method registers them."""
    registered = integration.algorithm.cameras(document)
    if registered is None:
        return {}
    of_views = zip(registered.view_indices, registered.own, registered.moved_m, registered.stds, strict=True)
    views = [
        {
            "view_index": view_index,
            "turned_deg": round(math.degrees(turn), 3),
            "swung_deg": round(math.degrees(math.hypot(*swing)), 3),
            "moved_mm": round(1e3 * float(moved_m), 2),
            "std_deg": [round(float(v), 3) for v in np.degrees(stds[:3])],
            "std_mm": [round(1e3 * float(v), 2) for v in stds[3:]],
        }
        for view_index, (turn, *swing), moved_m, stds in of_views
    ]
    return {"cameras": {"moved": registered.is_loose, "found": describe(registered), "views": views}}


def lines_of(outcome: dict[str, Any]) -> list[str]:
    """Return the report as a few lines of text."""
    accepted = outcome["accepted"]
    scores = [a["score"] for a in accepted if a["score"] is not None]
    views = [outcome["start_view"], *(a["view_index"] for a in accepted)]
    lines = [
        f"{outcome['recording']}: {len(views)} views integrated "
        f"({', '.join(str(v) for v in sorted(views))}), {outcome['area_cm2']:.0f} cm2."
    ]
    if scores:
        lines.append(f"Lowest score: {min(scores):.2f}.")
    if outcome["wrong"]:
        lines.append(told(outcome["wrong"]))
    elif "placement_std_median_mm" in outcome:
        lines.append(
            f"Placement uncertainty: {outcome['placement_std_median_mm']:.1f} mm (median std); "
            f"{outcome['firm_share']:.0%} reliable."
        )
    lines += _joint_line(outcome["joints"], "the cloth")
    if "cameras" in outcome:
        lines.append(outcome["cameras"]["found"])
    if "segmentation" in outcome:
        lines += [outcome["segmentation"]["text"], *outcome["segmentation"]["conflicts"]]
    if outcome["floating_cm2"]:
        areas = ", ".join(f"{area:.0f}" for area in outcome["floating_cm2"])
        lines.append(f"Floating pieces, connected by no view: {areas} cm2.")
    if outcome["left"]:
        left = ", ".join(str(view["view_index"]) for view in outcome["left"])
        lines.append(f"Left out, with the reasons in {FILE}: {left}.")
    lines.append(outcome["ended"])
    return lines


def _joint_line(joints: Sequence[dict[str, Any]], of: str) -> list[str]:
    """Return a line about the most doubtful joint of some, if more cloth than is negligible may be wrong."""
    return [
        f"{joint['area_cm2']:.0f} cm2, {joint['share']:.0%} of {of}, hang on one joint that is right with a"
        f" probability of {joint['probability']:.1%}."
        for joint in joints[:1]
        if joint["share"] * (1.0 - joint["probability"]) > NEGLIGIBLE
    ]


def view_lines(outcome: dict[str, Any]) -> list[str]:
    """Return a line a view: those that were accepted, in order, and those that were left out."""
    accepted = [
        f"View {view['view_index']} at {view['angle_deg']:g} degrees: accepted"
        + ("" if view["score"] is None else f", score {view['score']:.2f}")
        for view in outcome["accepted"]
    ]
    left = [
        f"View {view['view_index']} at {view['angle_deg']:g} degrees: left out, {view['reason']}"
        for view in outcome["left"]
    ]
    return accepted + left


def sides_entry(sides: JoinedSides | str) -> dict[str, Any]:
    """Return the report on the other side and its seams: areas in cm2, lengths in mm."""
    if isinstance(sides, str):
        return {"reason": sides}
    view, floating = sides.other.view, sides.other.floating
    return {
        "file": OTHER_FILE,
        "is_related": sides.is_related,
        "area_cm2": round(1e4 * view.area_m2, 1),
        "floating": [
            {"file": other_floating_file(n), "area_cm2": round(1e4 * piece.area_m2, 1)}
            for n, piece in enumerate(floating, start=1)
        ],
        **uncertainty(view),
        "joints": [_joint(each, view.area_m2) for each in sides.weak],
        "seams": [_seam(seam) for seam in sides.seams],
    }


def _seam(seam: Seam) -> dict[str, Any]:
    views, counts = np.unique(seam.views[seam.views >= 0], return_counts=True)
    return {
        "this_piece": seam.this_piece,
        "other_piece": seam.other_piece,
        "joins": not seam.why,
        "reason": seam.why,
        "probability": round(seam.probability, 3),
        "decided": seam.decided,
        "length_mm": round(1e3 * seam.length_m),
        "matches": len(seam.residual_m),
        "residual_mm": round(1e3 * float(np.median(seam.residual_m)), 1),
        "views": views[np.argsort(-counts)].tolist(),
    }


def other_side_lines(entry: dict[str, Any]) -> list[str]:
    """Return the report on the other side as a few lines of text."""
    if "reason" in entry:
        return [entry["reason"]]
    joined = [seam for seam in entry["seams"] if seam["joins"]]
    length_cm = sum(seam["length_mm"] for seam in joined) / 10
    relation = "joined by no seam"
    if entry["is_related"]:
        sure = f"the surest right with a probability of {max(seam['probability'] for seam in joined):.1%}"
        relation = f"joined along {length_cm:.0f} cm of seams, {sure}"
    line = f"Other side: {entry['area_cm2']:.0f} cm2, {relation}"
    if "firm_share" in entry:
        line += f"; {entry['firm_share']:.0%} reliable"
    if entry["floating"]:
        areas = ", ".join(f"{piece['area_cm2']:.0f}" for piece in entry["floating"])
        line += f"; floating pieces: {areas} cm2"
    kept = sum(seam["decided"] == "keep" for seam in joined)
    if kept:
        line += f". {kept} of its seams are kept by decisions, of the garment or by hand"
    return [f"{line}.", *_joint_line(entry["joints"], "the other side")]


def has_other_side(folder: Path) -> bool:
    """Return whether the report in a folder has the other side of the item."""
    try:
        return decoded(read_plain(folder / FILE), dict[str, Any]).get("other_side") is not None
    except (OSError, ValueError):
        return False


def outcome_text(outcome: dict[str, Any]) -> str:
    """Return the content of ``outcome.json``."""
    return json.dumps(outcome, indent=1) + "\n"
