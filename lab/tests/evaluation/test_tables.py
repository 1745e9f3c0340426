"""Tables from records, and results from their file."""

import csv
import json
from pathlib import Path

from unshutter_lab.evaluation.case import Record
from unshutter_lab.evaluation.protocols import PROTOCOLS, Request
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.tables import all_tables, as_csv, short_tables, tables


def record(estimator: str, epe: float, group: str = "g", **more: object) -> Record:
    scores = {"curvature_epe": epe / 2, "tx_rmse": epe, "rz_rmse": 0.5, "declined": "", "failed": ""}
    place = {"suite": "256 px", "group": group, "photo": f"{epe}", "draw": 0, "estimator": estimator}
    return place | {"epe": epe, "epe_nothing": 4.0} | scores | more


def test_tables_by_hand() -> None:
    records = [record("a", e) for e in (1, 2, 3, 10)] + [record("b", 4.0) for _ in range(4)]
    table = tables(Results(Request("synthetic", (Path("g"),)), ["a", "b"], [], records)).splitlines()
    cells = [cell.strip() for cell in table[2].split("|")[1:-1]]
    assert cells[:7] == ["g", "a", "4", "**2.50**", "**4.00**", "7.90", "**75%**"]
    assert [cell.strip() for cell in table[3].split("|")[4:8]] == ["4.00", "**4.00**", "**4.00**", "0%"]


def test_pictures_without_a_figure_do_not_count() -> None:
    scores = {"psnr": 20.0, "psnr_input": 17.0, "ssim": None, "ssim_input": None}
    records = [record("a", 1.0, **scores), record("a", 2.0, psnr=None, psnr_input=None, ssim=None, ssim_input=None)]
    results = Results(Request("pairs", (Path("g"),)), ["a"], [], records)
    assert "| 20.00 dB | 17.00 dB | +3.00 dB | – | 100% | – | – |" in tables(results)


def test_short_tables_and_csv_hold_the_same_figures() -> None:
    records = [record("a", 1.0), record("b", 8.0), record("a", 2.0, "h"), record("b", 3.0, "h")]
    every = all_tables(Results(Request("synthetic", (Path("g"), Path("h"))), ["a", "b"], [], records))
    assert "| a | **1.00**, **100%** | **2.00**, **100%** |" in short_tables(every, "motion")
    rows = list(csv.DictReader(as_csv(every).splitlines()))
    assert [(row["suite"], row["photos"], row["estimator"]) for row in rows][:2] == [
        ("256 px", "g", "a"),
        ("256 px", "g", "b"),
    ]
    assert (rows[1]["EPE median"], rows[1]["improved [%]"], rows[1]["t_x RMSE [px]"]) == ("8.00", "0", "8.00")
    assert len(rows[0]) == len(set(rows[0])) and not any("*" in cell for row in rows for cell in row.values())


def test_results_come_back_from_their_file(tmp_path: Path) -> None:
    request = Request("trajectory", (Path("x/g"),), 3, 1, 7, Path("logs"))
    results = Results(request, ["a"], ["ceiling"], [record("a", 1.0)], {"unshutter": "1"}, {})
    (tmp_path / "results.json").write_text(results.to_json())
    assert Results.load(tmp_path / "results.json") == results
    older = json.loads(results.to_json())
    older |= {"about": older.pop("environment"), "rivals": older.pop("oracles")}
    (tmp_path / "older.json").write_text(json.dumps(older))
    assert Results.load(tmp_path / "older.json") == results
    assert results.command == (
        "unshutter evaluate --protocol trajectory --data x/g --trajectory logs --photos 3 --per-photo 1 --seed 7 "
        "--estimators a"
    )


def test_the_command_line_knows_every_protocol() -> None:
    from typing import get_args

    from unshutter_lab.commands import ProtocolName

    assert set(get_args(ProtocolName)) == set(PROTOCOLS)
