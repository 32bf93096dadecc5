"""A survey from its inputs to its report, read top-down."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from uw_recon_ros.errors import BagError
from uw_recon_ros.files.atomic import write_bytes, write_json
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.kernel_warmup import tell_if_cold
from uw_recon_ros.progress import Progress
from uw_recon_ros.recordings.listing import Listing, first_size, list_frames
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.recordings.sources import Source, find_sources, told_of_calibrations
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.survey.choose import choose, options_of
from uw_recon_ros.survey.executor import Executor, Lost
from uw_recon_ros.survey.job import Outcome, SurveyRequest, settings_of
from uw_recon_ros.survey.output_bag import assemble, is_assembled
from uw_recon_ros.survey.plan import Plan, save_plan
from uw_recon_ros.survey.report import write_report
from uw_recon_ros.survey.rig_estimate import rectify_rigs, sort_rigs
from uw_recon_ros.survey.store import BAG_PARTS, FAILED, UNRELIABLE, Row, Store, SurveyError, succeeded
from uw_recon_ros.survey.tables import codes, frames_csv, report, timing_csv
from uw_recon_ros.survey.worker import reconstruct_frame
from uw_recon_ros.system_errors import explain

_FINISHED = "finished.json"


def run_survey(request: SurveyRequest, make_executor: Callable[[], Executor], progress: Progress) -> Outcome:
    """Reconstruct what is not reconstructed yet, and write the report.

    Parameters
    ----------
    request : SurveyRequest
    make_executor : callable
        Called when there is work.
    progress : Progress

    Returns
    -------
    Outcome

    Raises
    ------
    ReconError
        Nothing can be done: no pairs, no rectification, other settings than the directory was begun with, a full disk.
    """
    started = time.monotonic()
    request.check_extras()
    sources = find_sources(request.inputs)
    with Store(request.output) as store:
        settings = settings_of(request, sources, progress)
        store.claim(settings, overwrite=request.overwrite)
        listing = _list(request, sources, progress)
        standing = frozenset(_standing(store, listing.frames))
        run = _Run(request, store, sources, settings, listing, standing, progress, started)
        if len(standing) == len(listing.frames) and (store.state / _FINISHED).is_file():
            progress.line(f"{request.output}: already complete; --overwrite starts over")
        else:
            run.go_on(make_executor())
        return run.outcome()


def _list(request: SurveyRequest, sources: list[Source], progress: Progress) -> Listing:
    options = options_of(request.survey)
    size = partial(first_size, sources, options)
    given = read_calibration(request.calibration, size) if request.calibration else None
    listing = list_frames(sources, options, given, request.pipeline.rectify.images_rectified)
    listing.frames = choose(listing.frames, request.survey)
    listing.frames, more = sort_rigs(listing.frames, listing.calibrations, request.pipeline.rectify)
    listing.notes += more
    told = [sentence for source in sources for sentence in told_of_calibrations(source, request.calibration)]
    for sentence in [*told, *listing.unreadable, *listing.notes]:
        progress.line(f"note: {sentence}")
    return listing


def _standing(store: Store, frames: list[Frame]) -> dict[int, Row]:
    """Rows of frames that need not be done again."""
    assembled = is_assembled(store)
    wanted = {frame.number for frame in frames}
    rows = {number: row for number, row in store.rows().items() if number in wanted and not row.get("retry")}
    return {number: row for number, row in rows.items() if store.has_files(_needed(row, assembled))}


def _needed(row: Row, assembled: bool) -> dict[str, int]:
    return {name: size for name, size in row["files"].items() if not (assembled and name.startswith(BAG_PARTS))}


@dataclass(frozen=True)
class _Run:
    """One go at a survey. Rows stay in the journal until the end: memory does not grow with the frames."""

    request: SurveyRequest
    store: Store
    sources: list[Source]
    settings: dict[str, Any]
    listing: Listing
    standing: frozenset[int]
    progress: Progress
    started: float

    def go_on(self, executor: Executor) -> None:
        """Do what is missing, then the tables and the report."""
        try:
            rigs = self._reconstruct(executor)
            self._finish(rigs, executor.description)
        except (OSError, MemoryError) as error:
            told = explain(error) if isinstance(error, OSError) else "no memory is left: use fewer jobs"
            raise SurveyError(f"{self.request.output}: stopped: {told}; the same command resumes there") from error
        finally:
            executor.close()

    def _reconstruct(self, executor: Executor) -> dict[int, Rectification]:
        rigs, hand = self._prepare(executor)
        todo = [frame for frame in self.listing.frames if frame.number not in self.standing]
        before = f", {len(self.standing)} of them done before" if self.standing else ""
        self.progress.line(f"{len(self.listing.frames)} frames{before}; {executor.description}")
        if todo:
            tell_if_cold(self.progress.line, [self.request.pipeline.match.method])
        told: set[str] = set()
        results = executor.run(reconstruct_frame, map(hand, todo))
        for task, result in self.progress.watch(results, "frames", len(self.listing.frames), len(self.standing)):
            row = self._lost_row(task.frame, result) if isinstance(result, Lost) else result
            self.store.append(row)
            if not succeeded(row):
                self.progress.line(f"frame {row['frame']}: {row['reason']}")
                continue
            for code in set(codes(row)) - told:
                told.add(code)
                self.progress.line(_first_of_its_kind(row, code))
        return rigs

    def _prepare(self, executor: Executor) -> tuple[dict[int, Rectification], Callable[[Frame], Any]]:
        """Rectifications of all rigs, and what makes tasks of frames."""
        request, listing = self.request, self.listing
        root = str(self.store.root.absolute())
        plan = Plan(root, self.sources, listing.calibrations, request.survey, request.pipeline)
        if any(frame.rig < 0 for frame in listing.frames):
            self.progress.line("no calibration: estimating the rig from frames spread over the survey")
        rigs, notes = rectify_rigs(
            listing.frames, listing.calibrations, request.pipeline.rectify, request.survey.rig_frames, executor,
            save_plan(plan, self.store.state), self.store.state,
        )  # fmt: skip
        listing.notes += notes
        return rigs, save_plan(plan.with_rectifications(rigs), self.store.state)

    def _lost_row(self, frame: Frame, lost: Lost) -> Row:
        """A frame whose process died; the next run tries it again."""
        return {
            "frame": frame.number, "source": self.sources[frame.source].name, "stamp_ns": frame.stamp_ns,
            "status": FAILED, "reason": lost.reason, "files": {}, "seconds": 0.0, "stages_seconds": {}, "retry": True,
        }  # fmt: skip

    def _rows(self) -> list[Row]:
        rows = self.store.rows()
        return [rows[frame.number] for frame in self.listing.frames]

    def _finish(self, rigs: dict[int, Rectification], workers: str) -> None:
        """The bag, the tables and the report, once all frames are there."""
        rows, store, listing = self._rows(), self.store, self.listing
        self._assemble(rows)
        write_bytes(store.root / "frames.csv", frames_csv(rows), durable=True)
        write_bytes(store.root / "timing.csv", timing_csv(rows), durable=True)
        made = report(self.settings, rows, rigs, listing.pairs, listing.notes, listing.unreadable)
        write_json(store.root / "report.json", made)
        write_json(store.root / "run.json", self._facts(workers, rows))
        write_report(store, rows, made)
        write_json(store.state / _FINISHED, {"frames": len(rows)})

    def _assemble(self, rows: list[Row]) -> None:
        if "bag" not in self.request.survey.products:
            return
        shares = [row["frame"] for row in rows if any(name.startswith(BAG_PARTS) for name in row["files"])]
        try:
            assemble(self.store, shares, lambda parts: self.progress.watch(parts, "frames into the bag", len(shares)))
        except BagError as error:
            raise SurveyError(f"{error}; the same command resumes there") from error

    def _facts(self, workers: str, rows: list[Row]) -> dict[str, Any]:
        """Of this run alone: what it ran on, how long it took, the memory it needed."""
        seconds, done = time.monotonic() - self.started, len(rows) - len(self.standing)
        return {
            "workers": workers,
            "frames_done": done,
            "frames_there_before": len(self.standing),
            "seconds": round(seconds, 3),
            "frames_per_second": round(done / max(seconds, 1e-9), 4),
            "peak_memory_mb": {
                "a worker": max((row["peak_mb"] for row in rows if row.get("peak_mb")), default=None),
                "main process": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
            },
        }

    def outcome(self) -> Outcome:
        """How it ended."""
        rows = self._rows()
        failed = sum(not succeeded(row) for row in rows)
        doubtful = [row for row in rows if row["status"] == UNRELIABLE]
        why = [f["code"] for row in doubtful for f in row["findings"] if f["severity"] == UNRELIABLE]
        return Outcome(
            str(self.request.output), len(rows), len(rows) - failed, failed, len(self.standing),
            tuple(self.listing.unreadable), tuple(self.listing.notes), round(time.monotonic() - self.started, 3),
            len(doubtful), tuple(dict.fromkeys(why)),
        )  # fmt: skip


def _first_of_its_kind(row: Row, code: str) -> str:
    first = next(finding for finding in row["findings"] if finding["code"] == code)
    mark = "UNRELIABLE: " if first["severity"] == UNRELIABLE else ""
    return f"frame {row['frame']}: {mark}{first['text']} (further frames of this kind: frames.csv)"
