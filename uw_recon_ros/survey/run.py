"""A survey from its inputs to its report, read top-down."""

from __future__ import annotations

import importlib.util
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from uw_recon_ros.calibration import read_calibration
from uw_recon_ros.errors import BagError
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.survey.executor import Executor, Lost
from uw_recon_ros.survey.frame import reconstruct_frame
from uw_recon_ros.survey.listing import Frame, Listing, list_frames
from uw_recon_ros.survey.output_bag import assemble, is_assembled
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.plan import Plan, save_plan, versions
from uw_recon_ros.survey.rectify_once import rectify_rigs, sort_rigs
from uw_recon_ros.survey.report import write_report
from uw_recon_ros.survey.sources import Source, find_sources, fingerprint, sha256, source_files
from uw_recon_ros.survey.store import Row, Store, SurveyError, write_durably, write_json
from uw_recon_ros.survey.tables import frames_csv, report, timing_csv
from uw_recon_ros.survey.telling import Teller
from uw_recon_ros.survey.write import BAG_PARTS

_INERT = {"match_threads"}  # the output does not depend on it
_FINISHED = "finished.json"


@dataclass(frozen=True)
class Outcome:
    """How a survey ended.

    Parameters
    ----------
    output : str
    frames, ok, failed : int
        Chosen pairs, and what became of them.
    resumed : int
        How many of these were there before this run.
    unreadable : tuple of str
        Inputs of which nothing could be used, with the reason.
    notes : tuple of str
        What was damaged or odd, a sentence each.
    seconds : float
        Of this run.
    """

    output: str
    frames: int
    ok: int
    failed: int
    resumed: int
    unreadable: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every chosen pair of every input was reconstructed."""
        return not self.failed and not self.unreadable


@dataclass(frozen=True)
class Request:
    """What was asked for.

    Parameters
    ----------
    inputs : sequence of str
        Bags, folders of bags, folders of stills.
    output : str
        Directory.
    pipeline : PipelineParams
    survey : SurveyParams
    calibration : str or None
        File to take instead of what the inputs say.
    overwrite : bool
        Whether to clear what another survey left in `output`.
    """

    inputs: Sequence[str]
    output: str
    pipeline: PipelineParams
    survey: SurveyParams
    calibration: str | None = None
    overwrite: bool = False


def run_survey(request: Request, make_executor: Callable[[], Executor], teller: Teller) -> Outcome:
    """Reconstruct what is not reconstructed yet, and write the report.

    Parameters
    ----------
    request : Request
    make_executor : callable
        Called when there is work.
    teller : Teller

    Returns
    -------
    Outcome

    Raises
    ------
    ReconError
        Nothing can be done: no pairs, no rectification, other settings than the directory was begun with, a full disk.
    """
    started = time.monotonic()
    _check_extras(request.survey)
    sources = find_sources(request.inputs)
    with Store(request.output) as store:
        settings = _settings(request, sources, teller)
        store.claim(settings, overwrite=request.overwrite)
        listing = _list(request, sources, teller)
        rows = _standing(store, listing.frames)
        if len(rows) == len(listing.frames) and (store.state / _FINISHED).is_file():
            teller.line(f"{request.output}: finished before, nothing to do (--overwrite begins anew)")
            return _outcome(request, listing, rows, len(rows), started)
        executor = make_executor()
        try:
            resumed = len(rows)
            rigs = _work(request, store, sources, listing, rows, executor, teller)
            _finish(request, store, settings, listing, rows, rigs, teller, executor.description, resumed, started)
        except (OSError, MemoryError) as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise SurveyError(f"{request.output}: stopped: {reason}; the same command goes on from there") from error
        finally:
            executor.close()
        return _outcome(request, listing, rows, resumed, started)


def _check_extras(params: SurveyParams) -> None:
    if params.cloud_format == "laz" and not importlib.util.find_spec("laspy"):
        raise SurveyError("cloud_format laz: expected the extra 'laz' to be installed: pip install uw_recon_ros[laz]")


def _settings(request: Request, sources: list[Source], teller: Teller) -> dict[str, Any]:
    """Everything the output depends on; the same settings give the same bytes."""
    total = sum(file.stat().st_size for source in sources for file in source_files(source))
    read = _Meter(teller, total)
    names: dict[str, dict[str, str]] = {}
    for source in sources:
        name = source.name if source.name not in names else f"{source.name} ({len(names)})"
        names[name] = fingerprint(source, read)
    stages = (
        request.pipeline.preprocess,
        request.pipeline.rectify,
        request.pipeline.match,
        request.pipeline.reconstruct,
    )
    return {
        "input": names,
        "calibration": sha256(request.calibration) if request.calibration else None,
        "survey": _values(request.survey),
        "parameters": {name: value for stage in stages for name, value in _values(stage).items() if name not in _INERT},
        "versions": versions(),
    }


def _values(params: Any) -> dict[str, Any]:
    return {spec.name: getattr(params, spec.name) for spec in params.specs()}


class _Meter:
    """Says now and then how much of the input is read."""

    def __init__(self, teller: Teller, total: int) -> None:
        self._teller, self._total, self._read, self._said = teller, total, 0, time.monotonic()

    def __call__(self, count: int) -> None:
        self._read += count
        if time.monotonic() - self._said > 5:
            self._said = time.monotonic()
            self._teller.line(f"checking input: {self._read / 1e9:.1f} of {self._total / 1e9:.1f} GB")


def _list(request: Request, sources: list[Source], teller: Teller) -> Listing:
    given = read_calibration(request.calibration) if request.calibration else None
    listing = list_frames(sources, request.survey, given)
    listing.frames, more = sort_rigs(listing.frames, listing.calibrations, request.pipeline.rectify)
    listing.notes += more
    for sentence in [*listing.unreadable, *listing.notes]:
        teller.line(f"note: {sentence}")
    return listing


def _standing(store: Store, frames: list[Frame]) -> dict[int, Row]:
    """Rows of frames that need not be done again."""
    assembled = is_assembled(store)
    wanted = {frame.number for frame in frames}
    rows = {number: row for number, row in store.rows().items() if number in wanted and not row.get("retry")}
    return {number: row for number, row in rows.items() if store.has_files(_needed(row, assembled))}


def _needed(row: Row, assembled: bool) -> dict[str, int]:
    return {name: size for name, size in row["files"].items() if not (assembled and name.startswith(BAG_PARTS))}


def _work(
    request: Request,
    store: Store,
    sources: list[Source],
    listing: Listing,
    rows: dict[int, Row],
    executor: Executor,
    teller: Teller,
) -> dict[int, Rectification]:
    """Reconstruct the frames that are missing in `rows`, and add them."""
    plan = Plan(str(store.root.absolute()), sources, listing.calibrations, request.survey, request.pipeline)
    hand = save_plan(plan, store.state)
    rigs, notes = rectify_rigs(
        listing.frames, listing.calibrations, request.pipeline.rectify, request.survey.rig_frames, executor, hand,
        store.state,
    )  # fmt: skip
    listing.notes += notes
    hand = save_plan(plan.with_rectifications(rigs), store.state)
    todo = [frame for frame in listing.frames if frame.number not in rows]
    if rows and todo:
        teller.line(f"going on: {len(rows)} of {len(listing.frames)} frames are there")
    results = executor.run(reconstruct_frame, map(hand, todo))
    for task, result in teller.watch(results, "frames", len(listing.frames), len(rows)):
        frame = task.frame
        row = _lost_row(frame, sources, result) if isinstance(result, Lost) else result
        store.append(row)
        rows[frame.number] = row
        if row["status"] != "ok":
            teller.line(f"frame {frame.number}: {row['reason']}")
    return rigs


def _lost_row(frame: Frame, sources: list[Source], lost: Lost) -> Row:
    """A frame whose process died; the next run tries it again."""
    return {
        "frame": frame.number, "source": sources[frame.source].name, "stamp_ns": frame.stamp_ns, "status": "failed",
        "reason": lost.reason, "files": {}, "seconds": 0.0, "stages_seconds": {}, "retry": True,
    }  # fmt: skip


def _finish(
    request: Request,
    store: Store,
    settings: dict[str, Any],
    listing: Listing,
    rows: dict[int, Row],
    rigs: dict[int, Rectification],
    teller: Teller,
    workers: str,
    resumed: int,
    started: float,
) -> None:
    """The bag, the tables and the report, once all frames are there."""
    ordered = [rows[frame.number] for frame in listing.frames]
    if "bag" in request.survey.products:
        shares = [row["frame"] for row in ordered if any(name.startswith(BAG_PARTS) for name in row["files"])]
        try:
            assemble(store, shares, lambda parts: teller.watch(parts, "frames into the bag", len(shares)))
        except BagError as error:
            raise SurveyError(f"{error}; the same command goes on from there") from error
    write_durably(store.root / "frames.csv", frames_csv(ordered))
    write_durably(store.root / "timing.csv", timing_csv(ordered))
    made = report(settings, ordered, rigs, listing.pairs, listing.notes, listing.unreadable)
    write_json(store.root / "report.json", made)
    write_json(store.root / "run.json", _run_facts(workers, ordered, resumed, started))
    write_report(store, ordered, made)
    write_json(store.state / _FINISHED, {"frames": len(ordered)})


def _run_facts(workers: str, rows: list[Row], resumed: int, started: float) -> dict[str, Any]:
    """Of this run alone: what it ran on, how long it took, the memory it needed."""
    seconds, done = time.monotonic() - started, len(rows) - resumed
    peaks = [row["peak_mb"] for row in rows if row.get("peak_mb")]
    return {
        "workers": workers,
        "frames_done": done,
        "frames_there_before": resumed,
        "seconds": round(seconds, 3),
        "frames_per_second": round(done / seconds, 4) if seconds > 0 else None,
        "peak_memory_mb": {
            "a worker": max(peaks, default=None),
            "main process": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        },
    }


def _outcome(request: Request, listing: Listing, rows: dict[int, Row], resumed: int, started: float) -> Outcome:
    failed = sum(row["status"] != "ok" for row in rows.values())
    return Outcome(
        str(request.output), len(rows), len(rows) - failed, failed, resumed, tuple(listing.unreadable),
        tuple(listing.notes), round(time.monotonic() - started, 3),
    )  # fmt: skip
