"""What the site has besides docs/: files of the checkout that pages link to, and the pages of the gallery.

MkDocs calls the functions by their names. ``python docs/site.py`` integrates the bundled recordings and
exports their pages to ``.venv/gallery`` (what is there stays); ``make docs`` does that first.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from mkdocs.plugins import event_priority
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
GALLERY = ROOT / ".venv" / "gallery"
SHOWN = ("shirt-sleeve-clean", "shirt-corner-d435", "trousers-waist-d435")
BESIDE = (
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "CITATION.cff",
    "Dockerfile",
    "LICENSE",
    "recordings/README.md",
    "static/icon.svg",
    "examples/*",
    "benchmarks/results/*.md",
    "benchmarks/results/*.json",
    "benchmarks/results/*.png",
)
"""Files that pages link to; they keep their paths, without the leading ``../``."""
_LINK = re.compile(r"(\]\()([^)#\s]+)")


@event_priority(100)  # before the plugin that turns notebooks into pages
def on_files(files: Any, config: Any) -> Any:
    """Add the files from beside docs/, and the pages of the gallery."""
    beside = [path for one in BESIDE for path in sorted(ROOT.glob(one)) if path.is_file()]
    for path in beside:
        name = path.relative_to(ROOT).as_posix()
        files.append(File(name, str(ROOT), config.site_dir, config.use_directory_urls))
    for name in SHOWN:
        if (page := GALLERY / f"{name}.html").exists():
            files.append(File.generated(config, f"try/{name}.html", abs_src_path=str(page)))
    for source in ("film.py", "growth.py", "site.py"):
        files.remove(files.get_file_from_path(source))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links between docs/ and the rest of the checkout to where those files are in the site."""
    if page.file.src_uri == "gallery.md":
        markdown = markdown.replace("<!-- tries -->", tries())
    folder = Path(page.file.src_uri).parent
    # A page of docs/ is one folder higher in the site than in the checkout.
    place = (
        folder
        if str(folder) != "." or page.file.src_uri in ("CONTRIBUTING.md", "CHANGELOG.md")
        else Path("docs")
    )

    def led(found: re.Match[str]) -> str:
        target = found[2]
        if "://" in target:
            return found[0]
        aimed = (ROOT / place / target).resolve()
        if not aimed.is_relative_to(ROOT) or not aimed.exists():
            return found[0]
        name = aimed.relative_to(ROOT).as_posix().removeprefix("docs/")
        name = "index.md" if name == "README.md" else name
        return found[1] + "../" * len(folder.parts) + name

    return _LINK.sub(led, markdown)


def tries() -> str:
    """Return the embedded pages of the gallery, each with its figures."""
    parts = []
    for name in SHOWN:
        if not (GALLERY / f"{name}.html").exists():
            continue
        outcome = json.loads((GALLERY / name / "outcome.json").read_text())
        kind = (outcome["garment"]["kind"] or "no known kind").replace("_", " ")
        parts.append(
            f"## {name}\n\n{kind}, {1 + len(outcome['accepted'])} views, "
            f"{outcome['area_cm2']:.0f} cm², {outcome['firm_share']:.0%} of it placed to 10 mm or better. "
            f"[Alone in the window](try/{name}.html)\n\n"
            f'<iframe src="try/{name}.html" title="{name}" loading="lazy" '
            'style="width:100%;height:36rem;border:1px solid #8888"></iframe>\n'
        )
    return "\n".join(parts)


def make_gallery() -> None:
    """Integrate the recordings and export their pages, unless they are there."""
    for name in SHOWN:
        out, page = GALLERY / name, GALLERY / f"{name}.html"
        if page.exists():
            continue
        for command in (["run", name, "--out", str(out)], ["export", str(out), "--html", str(page)]):
            subprocess.run([sys.executable, "-m", "flatcloth", *command, "--quiet"], cwd=ROOT, check=True)


if __name__ == "__main__":
    make_gallery()
