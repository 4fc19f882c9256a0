"""The page's own files: no foreign code, no text put in as HTML, every element there."""

from __future__ import annotations

import re

from flatcloth.core.resources import static_folder

FILES = sorted(p for p in static_folder().rglob("*") if p.suffix in {".js", ".css", ".html", ".svg"})
FORBIDDEN = re.compile(
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function"
    r"|(?:https?:)?//(?!www\.w3\.org)[\w.-]+\.[a-z]{2,}"
)


def test_text_never_becomes_html_and_nothing_is_loaded_from_elsewhere():
    assert len(FILES) > 50
    found = {path.name: FORBIDDEN.findall(path.read_text()) for path in FILES}
    assert {name: what for name, what in found.items() if what} == {}
