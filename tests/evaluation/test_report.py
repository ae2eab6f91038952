import csv
import io
import json
import math

from rich.console import Console

from usvnet.evaluation.paper_tables import TABLE_2, TABLE_3
from usvnet.evaluation.report import nothing_found, print_report, range_table, write_report
from usvnet.evaluation.scores import finite, score
from usvnet.evaluation.tables import Column, Table

from .boats import boat, truth


def scores():
    truths = [[truth(range_m=10.0, scene="I")], [truth(range_m=20.0, scene="II")], [truth(range_m=7.0, scene="II")]]
    records = [[boat(truths[0][0], slant_m=10.5)], [boat(truths[1][0], slant_m=18.0)], []]
    return score(records, truths)


def test_markdown_of_a_known_table():
    table = Table(
        title="Errors",
        columns=[Column("Scene"), Column("n"), Column("MAE", digits=2), Column("hit", digits=0, percent=True)],
        rows=[["I", 3, 0.125, 0.5], ["all", 0, math.nan, None]],
        strong=frozenset({1}),
        note="A note.",
    )
    assert table.to_markdown() == (
        "## Errors\n\n"
        "| Scene | n | MAE | hit |\n"
        "| :--- | ---: | ---: | ---: |\n"
        "| I | 3 | 0.12 | 50 % |\n"
        "| **all** | **0** | - | - |\n"
        "\nA note.\n"
    )


def test_csv_holds_raw_values_and_empty_fields(tmp_path):
    table = Table("", [Column("scene"), Column("mae"), Column("n")], [["I", 0.123456789, 3], ["II", math.nan, 0]])
    table.write_csv(tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "scene,mae,n\nI,0.123457,3\nII,,0\n"


def test_the_range_table_puts_the_papers_figures_beside_ours():
    rows = {(row[0], row[1]): list(row[2:]) for row in range_table(scores()).rows}
    assert rows["I", "waterline"] == [1, 0, 0.25, 0.5, 0.5, 0.284, 0.533, 0.416]
    assert rows["II", "box_bottom"] == [1, 1, 4.0, 2.0, 2.0, 2.395, 1.548, 1.182]
    assert rows["all", "waterline"] == [2, 1, 2.125, math.sqrt(2.125), 1.25, None, None, None]


def test_everything_is_written_and_no_json_holds_nan(tmp_path):
    sheet = tmp_path / "overlays" / "scene_I.png"
    write_report(scores(), tmp_path, "usvnet-n", {"split": "test"}, [sheet])
    report = (tmp_path / "report.md").read_text()
    assert report.startswith("# Evaluation of usvnet-n\n\n- split: test\n")
    assert "| I | waterline | 1 | 0 | 0.250 | 0.500 | 0.500 | 0.284 | 0.533 | 0.416 |" in report
    assert "| paper: YOLO11m-pose | 1/7 | 0.940 | 0.845 | 0.898 | 0.757 |" in report
    assert "![scene_I](overlays/scene_I.png)" in report
    text = (tmp_path / "metrics.json").read_text()
    assert "NaN" not in text
    metrics = json.loads(text)
    assert metrics["ranges"]["overall"]["waterline"]["missed"] == 1
    assert metrics["pose"]["boats"] == 3
    (by_scene,) = [list(csv.DictReader(io.StringIO((tmp_path / "range_by_scene.csv").read_text())))]
    assert [row["mae_m"] for row in by_scene if row["estimator"] == "waterline"] == ["0.5", "2", "1.25"]


def test_without_any_laser_reading_there_is_no_range_table(tmp_path):
    unranged = score([[boat(truth())]], [[truth()]])
    write_report(unranged, tmp_path, "usvnet-n", {})
    report = (tmp_path / "report.md").read_text()
    assert "## Pose" in report
    assert "Slant range" not in report


def test_where_nothing_is_found_one_sentence_stands_for_tables_of_dashes(tmp_path):
    labelled = [truth(range_m=7.0, scene="I"), truth(200.0)]
    unsure = score([[boat(labelled[0], score=0.2)]], [labelled])
    out = io.StringIO()
    print_report(unsure, "usvnet-n", Console(file=out, width=96))
    write_report(unsure, tmp_path, "usvnet-n", {})
    for text in (out.getvalue(), (tmp_path / "report.md").read_text()):
        assert "None of the 2 labelled boats was found with a score of 0.25" in " ".join(text.split())
        assert "Pose" in text
        assert "Slant range" not in text
        assert "Keypoint error" not in text
    assert (tmp_path / "keypoints.csv").read_text().startswith("Keypoint,n,median,95th percentile\n")
    empty = score([[]], [[]])
    assert nothing_found(empty) == ""  # no boat is labelled, so none is missing
    assert nothing_found(scores()) == ""


def test_a_log_file_gets_whole_lines():
    out = io.StringIO()
    print_report(scores(), "usvnet-n", Console(file=out, width=96))
    assert "…" not in out.getvalue()
    assert "stern_bottom" in out.getvalue()


def test_figures_that_do_not_exist_become_null():
    assert finite({"a": [1.0, math.nan, (math.inf, "x")], "b": None}) == {"a": [1.0, None, [None, "x"]], "b": None}


def test_the_papers_rmse_is_the_root_of_its_mse():
    """The printed formula forgets the square, the printed figures do not."""
    for by_scene in TABLE_3.values():
        for row in by_scene.values():
            assert abs(math.sqrt(row.mse_m2) - row.rmse_m) < 0.002
    assert len(TABLE_2) == 7
