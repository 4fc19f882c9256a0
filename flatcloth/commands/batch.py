"""The command ``batch``: many recordings, one table, and the page to review them."""

from __future__ import annotations

import contextlib
import functools
import time
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.commands.options import JOBS, PORT, POSITIVE, Method, Output, SourceInformation
from flatcloth.commands.output import ProgressBar, announce, report, say
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.batch.engines import Engine

SUMMARY = "integrate many recordings, with a table and a page to review the results"
EXAMPLES = """examples:
  flatcloth batch my-recordings/* --out night --jobs 4
  flatcloth batch MultimodalClothes --turning 240 --out night --scheduler tls://host:8786
  flatcloth batch list.csv --out night                   a table: source, and options as columns
  flatcloth batch night --report                         night/report.html, one page, offline
  flatcloth batch night --coco keypoints                 COCO keypoints, with the images
  flatcloth batch night --review                         the same page, with verdicts and sessions"""
_LOOKING = "looking at the results"


@dataclass(kw_only=True)
class Options(Output, SourceInformation, Method):
    """The options of the command."""

    sources: tuple[str, ...] = option(
        "recordings, folders of them, patterns, a data set, or a list of sources (.csv, .jsonl); with "
        "--report and --review the folder of a batch",
        "SOURCE",
        MISSING,
        positional=True,
    )
    out: Path | None = option("folder to write; what is done there stays", "DIR")
    jobs: int | None = option(
        "recordings at the same time, on this machine (default: all cores)", "N", either="engine", read=JOBS
    )
    scheduler: str | None = option(
        "instead: on the workers of a Dask scheduler, tls://host:8786", "ADDRESS", either="engine"
    )
    no_tls: bool = option(
        "use a scheduler that asks for no certificate: whoever reaches it can run code as you"
    )
    memory: float = option("memory that a recording may take beyond the libraries", "GB", 2.0, read=POSITIVE)
    time_limit: float = option("seconds that a recording may take", "S", 1800.0, read=POSITIVE)
    again: bool = option("do again what is done; the old is set aside")
    report: bool = option("write DIR/report.html from the results in DIR", group=_LOOKING)
    coco: Path | None = option(
        "write the views and the named points of the results in DIR as COCO keypoints", "DATASET",
        group=_LOOKING
    )  # fmt: skip
    review: bool = option("serve that page: verdicts are kept, a click opens the session", group=_LOOKING)
    port: int = option("port of --review, 0 for any free one", default=8090, group=_LOOKING, read=PORT)


def run(options: Options) -> None:
    """Run the batch, or make or serve its page."""
    if options.report or options.review or options.coco:
        _look(options)
        return
    if options.out is None:
        raise FlatclothError("--out names no folder; give one for the results.")
    from flatcloth.batch.drive import owned, pending, run_batch
    from flatcloth.batch.engines import Limits, engine_of
    from flatcloth.batch.report import write_report
    from flatcloth.batch.rows import CSV
    from flatcloth.batch.tasks import tasks_of

    out = options.out.expanduser()
    limits = Limits(memory_bytes=int(options.memory * 1e9), seconds=options.time_limit)
    with owned(out):
        tasks = tasks_of(options.sources, options.method, options.source_options(), out)
        waiting = pending(tasks, out, again=options.again)

        def start() -> Engine:
            engine = engine_of(options.jobs, options.scheduler, str(out.resolve()), tls=not options.no_tls)
            say(f"{len(tasks)} recordings; {engine.about}")
            return engine

        with _Teller(len(tasks), len(tasks) - len(waiting)) as teller:
            try:
                with contextlib.closing(run_batch(waiting, out, start, limits, again=options.again)) as rows:
                    for row in rows:
                        teller.tell(row)
            except KeyboardInterrupt:
                done = f"Stopped: {teller.done} of {teller.total} are done and kept."
                teller.line(f"{done} The same command goes on from there.")
                raise SystemExit(130) from None
        page = write_report(out)
    table = out / CSV
    document = {"table": str(table), "page": str(page), "rows": teller.rows}
    report(options, document, [teller.summary, f"Table: {table}. Page: {page}"])
    if teller.failed:
        raise FlatclothError(
            f"{out}: {teller.failed} of {teller.total} are not done; the table has the reasons. "
            "The same command tries them again."
        )


def _look(options: Options) -> None:
    from flatcloth.batch.report import write_report

    if len(options.sources) != 1 or options.out is not None:
        raise FlatclothError(
            "--report, --review and --coco take one folder, that of a batch: flatcloth batch DIR --report"
        )
    out = Path(options.sources[0]).expanduser()
    if options.coco:
        from flatcloth.export.coco import write_coco

        with os_errors_as(FlatclothError, f"{out}: cannot be read", "Name the folder of a batch."):
            folders = sorted(path for path in out.iterdir() if path.is_dir())
        results, images = write_coco(folders, options.coco)
        line = f"Written to {options.coco}: {images} images of {results} results."
        report(options, {"folder": str(options.coco), "results": results, "images": images}, [line])
    if not (options.report or options.review):
        return
    page = write_report(out)
    if not options.review:
        report(options, {"page": str(page)}, [f"Page: {page}"])
        return
    from flatcloth.commands import view
    from flatcloth.viewer.server.review import serve_review

    say(f"Page: {page}")

    def ready(url: str, token: str) -> None:
        announce(options, f"Review at {url} (Ctrl-C ends it)", url, token, page=str(page))

    serve_review(out, options.port, ready, functools.partial(view.opened_place, view.Options()))


class _Teller(ProgressBar):
    """Reports the progress of a batch: a bar on a terminal, lines in a log; failures are lines in both.

    ``total`` is the number of tasks, ``before`` that of those done before; ``rows`` are those of the others.
    """

    def __init__(self, total: int, before: int) -> None:
        super().__init__("batch")
        self.total, self.before = total, before
        self.rows: list[dict[str, Any]] = []
        self._started_s = time.monotonic()
        if before:
            say(f"{before} of {total} are done already.")
        self.show(before / max(1, total), f"{before} of {total}")

    @property
    def done(self) -> int:
        """Number of tasks that are done, or have failed."""
        return self.before + len(self.rows)

    @property
    def failed(self) -> int:
        """Number of tasks that have failed."""
        return sum(row["outcome"] != "done" for row in self.rows)

    def tell(self, row: dict[str, Any]) -> None:
        """Report a new row, and the time left by the pace so far."""
        self.rows.append(row)
        pace_s = (time.monotonic() - self._started_s) / len(self.rows)
        left = f", {_time(pace_s * (self.total - self.done))} left"
        if row["outcome"] != "done":
            self.line(f"{row['name']}: {row['outcome']}: {row.get('reason')}")
        elif not self.is_shown:
            reliable = row.get("reliable_share")
            known = "" if reliable is None else f", {reliable:.0%} reliable"
            say(
                f"[{self.done}/{self.total}] {row['name']}: {row['area_cm2']:.0f} cm2{known}, "
                f"{row['seconds']:.1f} s{left}"
            )
        failed = f", {self.failed} failed" if self.failed else ""
        self.show(self.done / self.total, f"{self.done} of {self.total}{failed}{left}")

    @property
    def summary(self) -> str:
        """How the tasks ended, in a sentence."""
        from flatcloth.batch.rows import counted

        ended = ", ".join(f"{n} {outcome}" for outcome, n in counted(self.rows).items() if n)
        before = f"; {self.before} were done before" if self.before else ""
        return f"{ended or 'nothing to do'}{before}."


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"about {max(1, round(seconds))} s"
    return f"about {round(seconds / 60)} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"
