"""The page of a batch as a file and as served: order, what it holds, verdicts, and who may use it."""

import json
import math
import os
import re
import shlex
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from full_disks import full
from route_client import RouteClient

from flatcloth.batch.report import command_of, decide, read_verdicts, reliability, report_html, write_report
from flatcloth.batch.rows import FORMAT, write_row
from flatcloth.cli import main
from flatcloth.core.errors import JournalError
from flatcloth.viewer.server.guard import Endpoint, Guard
from flatcloth.viewer.server.review import SessionPage, review_app

GOOD = {"outcome": "done", "method": "robust", "source": "/data/x", "area_cm2": 900.0, "floating_cm2": 0.0}


@pytest.fixture
def out(tmp_path: Path) -> Path:
    rows = {
        "sure": {**GOOD, "reliable_share": 0.99, "coverage_estimate": 0.98},
        "less": {**GOOD, "reliable_share": 0.6, "coverage_estimate": 0.9, "version": "0.2"},
        "torn": {**GOOD, "reliable_share": 0.99, "coverage_estimate": 0.98, "floating_cm2": 900.0},
        "lost": {**GOOD, "outcome": "failed", "reason": "</script><b>&", "version": "0.1"},
    }
    for name, row in rows.items():
        write_row({"name": name, **row}, tmp_path / "night" / name)
    (tmp_path / "night/sure/thumbnail.webp").write_bytes(b"RIFF")
    return tmp_path / "night"


def data_of(html: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_the_page_holds_all_rows_least_reliable_first(out: Path) -> None:
    decide(out, "less", "accepted")
    data = data_of(write_report(out).read_text())
    assert [row["name"] for row in data["rows"]] == ["lost", "torn", "less", "sure"]
    rows = {row["name"]: row for row in data["rows"]}
    assert rows["lost"]["reason"] == "</script><b>&"
    assert rows["lost"]["reliability"] is None
    assert rows["sure"]["reliability"] == pytest.approx(0.99 * 0.98, abs=1e-4)
    assert rows["sure"]["thumbnail"].startswith("data:image/webp")
    assert rows["less"]["review"] == "accepted"
    assert "several versions" in data["notes"]
    assert data["served"] is False


def test_the_page_needs_nothing_else_and_no_text_ends_its_elements(out: Path) -> None:
    html = write_report(out).read_text()
    assert "</script><b>" not in html
    assert re.search(r'(src|href)="(?!data:|#)', html) is None
    assert "default-src 'none'" in html
    assert "import {" not in html


def test_reliability_is_the_share_of_what_was_seen_that_is_placed_and_joined() -> None:
    row = {"reliable_share": 0.8, "coverage_estimate": 0.5, "area_cm2": 300.0, "floating_cm2": 100.0}
    assert reliability(row) == pytest.approx(0.8 * 0.5 * 0.75)
    assert reliability({**row, "reliable_share": None, "least_score": 0.4}) == pytest.approx(0.15)
    assert reliability({}) == 0.0


def test_a_session_that_was_edited_since_is_marked(out: Path) -> None:
    journal = out / "sure/journal.jsonl"
    journal.touch()
    assert not next(r for r in data_of(report_html(out, served=False))["rows"] if r["name"] == "sure")[
        "edited"
    ]
    later = time.time() + 60
    os.utime(journal, (later, later))
    assert next(r for r in data_of(report_html(out, served=False))["rows"] if r["name"] == "sure")["edited"]


def test_the_command_opens_the_session_with_its_options(out: Path) -> None:
    said = {"turning_deg": -240.0, "camera_file": "/data/my camera.json"}
    row = {"name": "sure", **GOOD, "source": "/data/a b", "options": json.dumps(said)}
    begins = ["flatcloth", "view", "/data/a b", "--session", str(out / "sure"), "--method=robust"]
    expected = ["--camera-file=/data/my camera.json", "--turning=-240.0"]
    assert shlex.split(command_of(row, out)) == begins + expected
    row["options"] = json.dumps({"fov_deg": [60.0, 40.0]})
    assert shlex.split(command_of(row, out)) == [*begins, "--fov", "60.0", "40.0"]


def test_a_row_adds_no_options_to_the_command_and_names_no_other_folder(out: Path) -> None:
    said = {"fov_deg": ["--no-token", "--host=0.0.0.0"], "camera_file": "--no-token"}
    for options in (json.dumps(said), "[1]", "3", "{"):
        row = {**GOOD, "name": "../../home", "source": "--no-token", "options": options}
        write_row(row, out / "sure")
        (told,) = [row for row in data_of(report_html(out, served=False))["rows"] if row["name"] == "sure"]
        source, *options_of_session = shlex.split(told["command"])[2:]
        assert source == "./--no-token"
        assert options_of_session == ["--session", str(out / "sure"), "--method=robust"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"outcome": None}, {"outcome": []}, {"source": None}, {"method": 3}, {"area_cm2": "900"},
        {"views": 1.5}, {"views": True}, {"reason": ["x"]}, {"seconds": math.nan}, {"seconds": 10**20},
        {"floating_cm2": {}},
    ],
    ids=str,
)  # fmt: skip
def test_a_row_with_something_else_in_it_is_no_row(out: Path, wrong: dict[str, Any]) -> None:
    (out / "sure/row.json").write_text(json.dumps({**GOOD, "format": FORMAT, "name": "sure", **wrong}))
    rows = data_of(report_html(out, served=False))["rows"]
    assert sorted(row["name"] for row in rows) == ["less", "lost", "torn"]


def test_the_last_verdict_counts_and_is_on_a_result(out: Path) -> None:
    decide(out, "sure", "accepted")
    decide(out, "less", "rejected")
    decide(out, "sure", "rejected")
    decide(out, "less", None)
    assert read_verdicts(out) == ({"sure": "rejected"}, "")
    write_row({"name": "above", **GOOD}, out.parent)
    for name, verdict in (
        *(("nobody", "accepted"), ("sure", "maybe")),
        *((name, "accepted") for name in ("../night/sure", "..", ".", "")),
    ):
        with pytest.raises(JournalError):
            decide(out, name, verdict)


def test_damaged_verdicts_are_told_and_not_written_to(out: Path) -> None:
    decide(out, "sure", "accepted")
    text = (out / "review.json").read_text().replace("sure", "torn")
    (out / "review.json").write_text(text)
    assert read_verdicts(out)[0] == {}
    assert "review.json: damaged" in data_of(write_report(out).read_text())["notes"]
    with pytest.raises(JournalError, match=r"not kept.*review.json: damaged"):
        decide(out, "less", "accepted")
    assert (out / "review.json").read_text() == text


def test_a_verdict_that_does_not_fit_on_the_disk_is_refused_and_those_before_stay(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decide(out, "sure", "accepted")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(JournalError, match=r"cannot be written.*No space left"):
        decide(out, "less", "accepted")
    monkeypatch.undo()
    decide(out, "less", "rejected")
    assert read_verdicts(out) == ({"sure": "accepted", "less": "rejected"}, "")


class Pages(SessionPage):
    """Opens nothing, and remembers what it was asked."""

    def __init__(self) -> None:
        super().__init__(lambda _chosen, _current: None)
        self.asked: list[Path] = []

    def address(self, folder: Path) -> str:
        self.asked.append(folder)
        return "http://127.0.0.1:1/"


@pytest.fixture
def pages() -> Pages:
    return Pages()


@pytest.fixture
def client(out: Path, pages: Pages) -> RouteClient:
    return RouteClient(app=Guard(review_app(out, pages), Endpoint(), None, 80))


async def endless() -> AsyncIterator[bytes]:
    """A body without a length in its headers; a reader without a limit would never return."""
    while True:
        yield b" " * 1000


def test_served_it_refuses_what_is_not_its_own(client: RouteClient, out: Path, pages: Pages) -> None:
    said = {"name": "sure", "verdict": "accepted"}
    foreign = {"Origin": "http://evil.example"}
    assert client.post("/verdict", json=said, headers=foreign).status_code == 403
    assert client.get("/", headers={"Host": "evil.example"}).status_code == 403
    # A form of another page comes without an Origin in old browsers, but never as JSON.
    assert client.post("/verdict", data=said).status_code == 400
    assert (
        client.post("/verdict", content=b"{", headers={"Content-Type": "application/json"}).status_code == 400
    )
    other: list[Any] = [[], {"verdict": "accepted"}, {"name": 3}, {"name": "sure", "verdict": 1}]
    for wrong in (*other, {"name": "x" * 10_001}):
        assert client.post("/verdict", json=wrong).status_code == 400
    json_type = {"Content-Type": "application/json"}
    assert client.post("/verdict", content=endless(), headers=json_type).status_code == 400
    assert client.post("/verdict", json={"name": "nobody", "verdict": "accepted"}).status_code == 409
    write_row({"name": "above", **GOOD}, out.parent)
    for name, status in (("nobody", 404), ("../night/sure", 404), ("..", 404), ("", 404), ("lost", 409)):
        assert client.post("/open", json={"name": name}).status_code == status
    assert read_verdicts(out) == ({}, "")
    assert pages.asked == []


def test_served_it_needs_the_token_of_the_printed_address(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served: list[Any] = []

    class Server(uvicorn.Server):
        async def serve(self, sockets: Any = None) -> None:
            served.append(self.config.app)

    monkeypatch.setattr("flatcloth.viewer.server.limits.uvicorn.Server", Server)
    assert main(["batch", str(out), "--review", "--port", "0"]) == 0
    found = re.search(r"http://127\.0\.0\.1:\d+(/\?token=(\S+))", capsys.readouterr().out)
    assert main(["batch", str(out), "--review", "--port", "0", "--json"]) == 0
    line = json.loads(capsys.readouterr().out)
    assert line["token"] == found[2]
    assert line["url"].endswith(found[1])
    assert Path(line["page"]).is_file()
    client = RouteClient(app=served[0])
    for path in ("/", "/?token=wrong"):
        assert client.get(path).status_code == 403
    assert client.post("/open", json={"name": "sure"}).status_code == 403
    assert client.post("/verdict", json={"name": "sure", "verdict": "accepted"}).status_code == 403
    assert read_verdicts(out) == ({}, "")
    entered = client.get(found[1])
    assert (entered.status_code, entered.headers["location"]) == (303, "./")
    cookie = entered.headers["set-cookie"].split(";")[0]
    for header in ({"Cookie": cookie}, {"Authorization": f"Bearer {found[2]}"}):
        assert client.get("/", headers=header).status_code == 200


def test_the_report_command_writes_the_page(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["batch", str(out), "--report"]) == 0
    assert str(out / "report.html") in capsys.readouterr().out
