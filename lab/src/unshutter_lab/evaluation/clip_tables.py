"""Formats the results of clips as tables, with a line for each clip: what was found, gained and lost."""

from __future__ import annotations

from collections.abc import Sequence

from unshutter_lab.evaluation.case import NOTHING, Record
from unshutter_lab.evaluation.real_clips import OURS
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.tables import Table

_NAMES = {NOTHING: "as taken"}
_UNKNOWN = "–"


def real_clip_tables(results: Results) -> str:
    """Returns Markdown tables of what each program does to each clip, and of the clips' sources."""
    clips = _by_clip(results)
    ours = [_own_row(clip, records[OURS]) for clip, records in clips.items() if OURS in records]
    titles = ["clip", "ratio (t)", "readout found, ms", "rms", "95 %", "largest", "sharpness", "result"]
    parts = [_table(titles, ours)] if ours else []
    legend = "**Every program**: root mean square and largest step, px; sharpness; what got worse in bold."
    rows = [[clip, *(_steps(records.get(name)) for name in results.estimators)] for clip, records in clips.items()]
    parts += [legend, _table(["clip", *(_NAMES.get(name, name) for name in results.estimators)], rows)]
    listed = {clip: next(iter(records.values())) for clip, records in clips.items()}
    origins = [[clip, about["note"], about["source"]] for clip, about in listed.items() if about.get("source")]
    parts += [_table(["clip", "what is known of it", "from"], origins)] if origins else []
    return "\n\n".join(parts)


def rendered_clip_tables(results: Results) -> str:
    """Returns Markdown tables of what each method gains on each clip, and of what was found."""
    clips = _by_clip(results)
    rows = [[clip, *(_gain(records.get(name)) for name in results.estimators)] for clip, records in clips.items()]
    parts = [_table(["clip", *(_NAMES.get(name, name) for name in results.estimators)], rows)]
    ours = {clip: records[OURS] for clip, records in clips.items() if OURS in records}
    titles = ["clip", "shift, px", "readout, ms: true, found", "corner off by, px", "least gain of a frame, dB"]
    titles += ["share, whole pictures", "result"]
    parts += [_table(titles, [_found_row(clip, record) for clip, record in ours.items()])] if ours else []
    return "\n\n".join(parts)


def _gain(record: Record | None) -> str:
    if record is None:
        return _UNKNOWN
    share = "" if record["estimator"] == NOTHING or record["share"] is None else f" ({record['share']:.2f})"
    text = f"{record['psnr']:.2f}{share}"
    return f"**{text}**" if record["psnr"] < record["psnr_input"] else text


def _found_row(clip: str, record: Record) -> list[str]:
    corner = record.get("corner_px")
    share = record["share_whole"]
    figures = [f"{record['shift_px']:.1f}", f"{record['true_ms']:.1f}, {_readout(record)}"]
    figures += [_UNKNOWN if corner is None else f"{corner:+.1f}", f"{record['least']:+.2f}"]
    return [clip, *figures, _UNKNOWN if share is None else f"{share:.2f}", _result(record)]


def _by_clip(results: Results) -> dict[str, dict[str, Record]]:
    """Returns clip -> method -> its record."""
    clips: dict[str, dict[str, Record]] = {}
    for record in results.records:
        clips.setdefault(record["photo"], {})[record["estimator"]] = record
    return clips


def _own_row(clip: str, record: Record) -> list[str]:
    ratio = _UNKNOWN if record["ratio"] is None else f"{record['ratio']:.3f} ({record['ratio_t']:.0f})"
    steps = [f"{record[f'{key}_input']:.2f}, {record[key]:.2f}" for key in ("rms", "usual", "largest")]
    result = f"**worse**, {_result(record)}" if record["worse"] else _result(record)
    return [clip, ratio, _readout(record), *steps, f"{record['sharpness']:.2f}", result]


def _readout(record: Record) -> str:
    if record["readout_ms"] is None:
        return "not found"
    error = record["readout_error_ms"]
    return f"{record['readout_ms']:.1f}" + ("" if error is None else f" ± {error:.1f}")


def _result(record: Record) -> str:
    changed = round(record["straightened"] * record["frames"])
    return f"{changed} of {record['frames']} frames straightened" if changed else f"copied: {record['left']}"


def _steps(record: Record | None) -> str:
    if record is None:
        return _UNKNOWN
    text = f"{record['rms']:.2f}, {record['largest']:.2f}"
    text = f"**{text}**" if record["worse"] else text
    return text if record["estimator"] == NOTHING else f"{text}; {record['sharpness']:.2f}"


def _table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return Table("", list(titles), [list(row) for row in rows]).markdown


CLIP_TABLES = {
    "rendered clips": rendered_clip_tables,
    "real clips": real_clip_tables,
}  # kind of a run -> its short tables
