"""Streams that lost frames, count from other starts or have clocks of their own: pairs as the names say."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flatcloth.checking.color import Shown, odds_of, pairing_findings, reduced
from flatcloth.checking.turns import item_pixels
from flatcloth.cli import main
from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording
from flatcloth.recordings.formats.naming import in_order, partners, without_partner

FEW = range(8)
TIMES_S = [1.7e9 + 3.0 * n + (0.7, 0.1, 0.4)[n % 3] for n in FEW]


def _plain(n: int) -> str:
    return f"{n:05d}"


NAMES: dict[str, tuple[Callable[[int], str], Callable[[int], str]]] = {
    "stems": (_plain, _plain),
    "prefix and suffix": (lambda n: f"color_{n:04d}", lambda n: f"{n:04d}_depth"),
    "not padded": (lambda n: f"{n + 7}", lambda n: f"depth{n + 7}"),
    "counted from other starts": (lambda n: f"{n + 100}", str),
    "seconds": (lambda n: f"{TIMES_S[n]:.6f}", lambda n: f"{TIMES_S[n] + 0.011:.6f}"),
    "milliseconds": (lambda n: f"{1e3 * TIMES_S[n]:.0f}", lambda n: f"{1e3 * TIMES_S[n] + 11:.0f}"),
    "nanoseconds and seconds": (lambda n: f"{1e9 * TIMES_S[n]:.0f}", lambda n: f"{TIMES_S[n] - 0.02:.3f}"),
    "another clock": (lambda n: f"{TIMES_S[n] - 1.6e9:.3f}", lambda n: f"{TIMES_S[n]:.3f}"),
    "dates": (lambda n: f"IMG_20260501_1230{3 * n:02d}", lambda n: f"D-2026-05-01-12-30-{3 * n:02d}.2"),
    "number and time": (
        lambda n: f"{n}_{1e3 * TIMES_S[n]:.0f}",
        lambda n: f"{n - (n > 4)}_{1e3 * TIMES_S[n] + 9:.0f}",
    ),
}


def paired(color: list[tuple[str, int]], depth: list[tuple[str, int]]) -> tuple[list[tuple[int, int]], str]:
    """Return which views' color and depth belong together by their names, and what is said of the others."""
    view_of = [{Path(kind, f"{name}.png"): n for name, n in named}
               for kind, named in (("color", color), ("depth", depth))]  # fmt: skip
    colors, depths = (in_order(list(files)) for files in view_of)
    found = partners(colors, depths)
    pairs = [(view_of[0][colors[one]], view_of[1][depths[other]]) for one, other in found.items()]
    return pairs, "".join(without_partner(colors, found, depths))


@pytest.mark.parametrize("name", NAMES)
def test_each_stream_lost_a_frame(name):
    color, depth = NAMES[name]
    pairs, said = paired([(color(n), n) for n in FEW if n != 2], [(depth(n), n) for n in FEW if n != 4])
    assert pairs == [(n, n) for n in FEW if n not in (2, 4)]
    assert f"left out: color/{color(4)}.png, depth/{depth(2)}.png." in said


def test_streams_of_different_rates_pair_at_the_common_times():
    color = [(f"{n / 30 + 5:.3f}", n // 3) for n in range(3 * len(FEW))]
    assert paired(color, [(f"{n / 10 + 5.004:.3f}", n) for n in FEW])[0] == [(n, n) for n in FEW]


@pytest.mark.parametrize("again", ["00003 (1)", "3"])
def test_a_duplicate_is_left_out_and_named(again):
    pairs, said = paired([*((_plain(n), n) for n in FEW), (again, 3)], [(_plain(n), n) for n in FEW])
    assert pairs == [(n, n) for n in FEW]
    assert f"left out: color/{again}.png." in said


@pytest.mark.parametrize(
    ("color", "depth", "cause"),
    [
        ([str(n + 1) for n in FEW], [str(n) for n in FEW], "pair in two ways"),
        ([str(n + 3) for n in FEW], [str(n) for n in FEW], "pair in two ways"),
        ([str(n + 100) for n in FEW if n], [str(n) for n in FEW], "pair in two ways"),
        (list("abcdefgh"), list("stuvwxy"), "has 8 images, but depth has 7, with other names"),
    ],
)
def test_names_that_do_not_tell_are_refused(color, depth, cause):
    with pytest.raises(RecordingError, match=f"^color.*{cause}.*the same name") as caught:
        paired(*([(name, n) for n, name in enumerate(names)] for names in (color, depth)))
    assert "\n" not in str(caught.value)


def test_steps_count_the_frames_that_both_streams_lost(take):
    named = [(str(n), n) for n in FEW if n != 5]
    assert open_recording(take(named, named), step_deg=10).angles_deg == tuple(10.0 * n for _, n in named)


@pytest.mark.parametrize("mask", ["{:05d}", "mask{}"])
def test_masks_pair_by_name_and_a_view_without_one_is_left_out(mask, take, half_views):
    named = [(_plain(n), n) for n in FEW]
    kept = [n for n in FEW if n != 3]
    recording = open_recording(take(named, named, [(mask.format(n), n) for n in kept]), step_deg=10)
    assert recording.angles_deg == tuple(10.0 * n for n in kept)
    for view, n in enumerate(kept):
        color, depth_mm, of_interest = half_views[1][n]
        assert (recording[view].color == color[..., ::-1]).all()
        np.testing.assert_allclose(recording[view].depth_m, 0.001 * depth_mm, atol=1e-6)
        assert (recording[view].mask == (of_interest > 0)).all()
    assert any("left out: color/00003.png." in note for note in recording.notes)


ALL = list(range(36))


TWICE = [*ALL[:12], 11, *ALL[12:-1]]


@pytest.fixture(scope="module")
def shown() -> list[Shown]:
    """The item and the color of the views of a bundled recording, as the check compares them."""
    recording = open_recording("shirt-corner-d435")
    frames = [recording[n] for n in ALL]
    return [reduced(frame, item_pixels(frame, 0.85, 0.35)) for frame in frames]


@pytest.mark.parametrize(
    ("color", "depth", "text"),
    [
        (ALL[3:], ALL[:-3], "shifted against each other by 3 views:"),
        (ALL, ALL[::-1], "in opposite order"),
        ([n for n in ALL if n != 7], [n for n in ALL if n != 20], "of views 7 to 19 are shifted"),
        (ALL, TWICE, "of views 12 to 35 are shifted"),
    ],
    ids=["three views", "backwards", "names that say nothing", "a frame twice"],
)
def test_what_names_do_not_tell_the_images_do(color, depth, text, shown):
    seen = [(shown[theirs][0], shown[own][1]) for own, theirs in zip(color, depth, strict=True)]
    (found,) = pairing_findings(*odds_of(seen), range(len(seen)), len(seen))
    assert text in found.text
    (mends,) = found.mends
    depth_of = {n: depth[n] for n in range(len(depth))} | {n: depth[m] for n, m in mends.depth_views}
    assert len(mends.leave_out) <= 3
    assert all(depth_of[n] == own for n, own in enumerate(color) if n not in mends.leave_out)


def test_a_shift_of_the_images_is_mended_and_the_turntable_is_not_blamed(take, capsys):
    named = [[(chr(0x61 + n // 26) + chr(0x61 + n % 26), view) for n, view in enumerate(views)]
             for views in (ALL, TWICE)]  # fmt: skip
    folder = take(*named)
    (folder / "angles.csv").write_text("\n".join(str(10 * n) for n in ALL))
    given = ["check", str(folder)]
    assert main([*given, "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)["findings"]
    assert found["name"] == "pairing"
    assert main([*given, *found["mends"][0]["options"].split()]) == 0
    assert "Nothing is wrong" in capsys.readouterr().out
