"""The page's own files: no foreign code, no text put in as HTML, every module there."""

from __future__ import annotations

import re

import pytest

from flatcloth.core.resources import static_folder

SCRIPTS = sorted(static_folder().rglob("*.js"))
FILES = sorted(p for p in static_folder().rglob("*") if p.suffix in {".js", ".css", ".html", ".svg"})


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_text_never_becomes_html(path):
    found = re.findall(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", path.read_text()
    )
    assert found == []


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_nothing_is_loaded_from_elsewhere(path):
    addresses = re.findall(r"(?:https?:)?//[\w.-]+\.[a-z]{2,}", path.read_text())
    assert [a for a in addresses if a != "http://www.w3.org"] == []


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_every_imported_module_and_name_exists(path):
    for names, module in re.findall(r'import \{([^}]+)\} from "(\.[\w./-]+)"', path.read_text()):
        exported = (path.parent / module).read_text()
        for name in (listed.split(" as ")[0].strip() for listed in names.split(",")):
            assert re.search(rf"export (?:async )?(?:function|const|class) {name}\b", exported), (
                module,
                name,
            )


def test_every_element_that_a_script_asks_for_is_in_the_page():
    ours = [path for path in FILES if path.parent.name not in {"offline", "batch"}]
    page = "".join(path.read_text() for path in ours if path.suffix == ".html")
    scripts = "".join(path.read_text() for path in ours if path.suffix == ".js")
    asked = set(re.findall(r'byId\("([\w-]+)"\)', scripts))
    there = set(re.findall(r'id="([\w-]+)"', page)) | set(
        re.findall(r'(?:\bid: "|make\(\s*"\w+#)([\w-]+)', scripts)
    )
    assert asked <= there


@pytest.mark.parametrize(
    "folder", [p for p in (static_folder(), *static_folder().iterdir()) if p.is_dir()], ids=lambda p: p.name
)
def test_no_folder_holds_more_than_fifteen_modules(folder):
    assert len(list(folder.glob("*.js"))) <= 15


@pytest.mark.parametrize("path", [p for p in FILES if p.suffix != ".svg"], ids=lambda p: p.name)
def test_files_and_lines_stay_short(path):
    lines = path.read_text().splitlines()
    assert len(lines) <= 450
    assert [n for n, line in enumerate(lines, 1) if len(line) > 120] == []
