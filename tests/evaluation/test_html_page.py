"""The page of an evaluation, read as a browser reads it."""

import base64
import math
import re

import cv2
import numpy as np
import pytest

from usvnet.evaluation.examples import TILE_PX, Example
from usvnet.evaluation.html import page as page_room
from usvnet.evaluation.html.page import render_page, write_page
from usvnet.evaluation.html.pictures import missed_examples, worst_examples
from usvnet.evaluation.html.svg import THEME
from usvnet.evaluation.records import ESTIMATORS

from .boats import boat, truth
from .pages import NASTY_NAME, NASTY_SCENE, Page, evaluation, fifteen_boats, nothing_of

SECTIONS = ("pose", "range", "errors", "intervals", "worst", "sensitivity", "configuration")
PANELS = 2 + len(ESTIMATORS) + 2 * 2 + len(ESTIMATORS) + len(ESTIMATORS) + 6
"""Precision-recall, scatter, errors by distance and by scene, reliability, budget, one error at a time."""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    return fifteen_boats(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def text(told):
    return render_page(told)


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


@pytest.fixture
def without_study(monkeypatch):
    """Leave the camera's sensitivity out: it takes seconds."""
    monkeypatch.setattr(page_room, "study_commonest_camera", lambda *_: None)


def test_every_section_is_there_and_linked(page):
    assert [section["id"] for section in page.all("section") if "id" in section] == list(SECTIONS)
    assert [link["href"] for link in page.all("a")] == [f"#{section}" for section in SECTIONS]
    assert len(page.all("h1")) == 1
    assert len(page.all("h2")) == len(SECTIONS)


def test_everything_is_in_the_page_and_nothing_is_fetched_or_run(page, text):
    assert "http" not in text.replace("http-equiv", "")
    assert not {"script", "link", "iframe", "object", "embed"} & {tag for tag, _ in page.elements}
    assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]
    for _, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "data", "action"):
            assert attributes.get(name, "#").startswith(("#", "data:image/"))
    assert not re.search(r"url\((?!#)", text)
    assert "@import" not in text
    (policy,) = [meta["content"] for meta in page.all("meta") if "http-equiv" in meta]
    assert policy.startswith("default-src 'none'")


def test_figures_are_drawn_and_described(page):
    panels = page.all("svg")
    assert len(panels) == PANELS
    labels = [panel["aria-label"] for panel in panels]
    assert all(panel["role"] == "img" for panel in panels)
    assert len(set(labels)) == PANELS
    assert "Predicted over measured range by fused: 13 boats, RMSE 0.71 m, 2 missed" in labels
    assert len(page.all("figcaption")) == len(page.all("figure"))


def test_identifiers_are_unique_and_all_that_is_pointed_at_exists(page, text):
    identifiers = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(identifiers) == len(set(identifiers))
    pointed_at = set(re.findall(r"url\(#([^)]*)\)", text)) | {use["href"].removeprefix("#") for use in page.all("use")}
    assert pointed_at <= set(identifiers)


def test_key_figures_fill_their_rows(page, text):
    """The grid of twelve columns is made for four figures of poses and three of ranges."""
    style = text.split("</style>")[0].split("@media (min-width: 44rem)")[1]
    columns = int(re.search(r"key-figures { grid-template-columns: repeat\((\d+),", style)[1])
    first = int(re.search(r"key-figures div { grid-column: span (\d+)", style)[1])
    from_place, later = map(int, re.search(r"div:nth-child\(n \+ (\d+)\) { grid-column: span (\d+)", style).groups())
    figures = len(page.all("dt"))
    assert figures == 7
    assert (from_place - 1) * first == (figures - from_place + 1) * later == columns


@pytest.mark.parametrize(
    ("title", "lines"),
    [
        ("pitch 0.3 deg", ["pitch", "0.3 deg"]),
        ("focal length -20 px", ["focal length", "-20 px"]),
        ("95th percentile", ["95th", "percentile"]),
        ("all, Monte Carlo", ["all, Monte", "Carlo"]),
        ("n", ["n"]),
    ],
)
def test_titles_of_columns_break_before_a_number_and_its_unit(title, lines):
    assert page_room.in_two_lines(title) == lines


def test_one_picture_is_not_many(tmp_path, without_study):
    told = Page(render_page(evaluation(tmp_path, 1, lambda n, of: [boat(of)], lambda n: [truth(range_m=10.0)])))
    assert any(text.startswith("1 picture of the split test, 1 labelled boat, 1 with a laser") for text in told.texts)


def test_figures_take_their_colours_from_the_page(text):
    style, body = text.split("</style>")
    for colour, variable in THEME.items():
        assert f": {colour}" not in body
        name = variable.removeprefix("var(").removesuffix(")")
        assert style.count(f"{name}: ") == 2, f"{name} is for light and dark"
    assert "var(--c0)" in body


def test_pictures_are_embedded_and_described(page):
    pictures = page.all("img")
    assert len(pictures) == 12 + 2
    for picture in pictures:
        kind, encoded = picture["src"].split(",")
        assert kind == "data:image/jpeg;base64"
        decoded = cv2.imdecode(np.frombuffer(base64.b64decode(encoded), np.uint8), cv2.IMREAD_COLOR)
        assert decoded.shape[1::-1] == TILE_PX
        assert picture["alt"].startswith("Close-up of a boat in ")


def test_the_worst_come_first_and_misses_stand_apart(page):
    names = [re.search(r"in (.*?): ", picture["alt"])[1] for picture in page.all("img")]
    assert names[:12] == [f"test/{n:02d}.jpg" for n in range(12, 0, -1)]
    assert names[12:] == ["test/13.jpg", "test/14.jpg"]
    headlines = [text for text in page.texts if re.fullmatch(r"[+-]\d+\.\d\d m \([+-]\d+ %\)", text)]
    assert headlines[:3] == ["+1.20 m (+6 %)", "-1.10 m (-6 %)", "+1.00 m (+6 %)"]


def test_names_cannot_bring_anything_into_the_page(tmp_path, without_study):
    told = nothing_of(tmp_path, "predictions")  # both pictures are shown, the first has the nasty name
    text = render_page(told)
    assert "<script" not in text.lower()
    assert "&lt;script&gt;alert(" in text
    assert any(NASTY_NAME in picture["alt"] for picture in Page(text).all("img"))


def test_scenes_cannot_either_nor_are_they_taken_for_formulas(page, text):
    assert "<script" not in text.lower()
    assert f"scene {NASTY_SCENE}" in page.texts
    assert NASTY_SCENE in page.texts  # also under the bars


def test_figures_of_the_tables_stand_in_the_page(page):
    assert "0.284" in page.texts, "the paper's Table 3, scene I, waterline"
    assert {"0.025", "1/7", "paper: YOLO11m-pose", "abc123", "2.99"} <= set(page.texts)
    assert all(cell.get("scope") for cell in page.all("th"))
    assert any("root: <my boats>" in text for text in page.texts)


@pytest.mark.parametrize(
    ("missing", "sentence"),
    [
        ("pictures", "No boat of this split is labelled with keypoints"),
        ("labels", "No boat of this split is labelled with keypoints"),
        ("readings", "No boat of this split has a laser reading"),
        ("predictions", "No labelled boat was ranged."),
    ],
)
def test_what_is_missing_is_said_and_the_rest_is_there(tmp_path, without_study, missing, sentence):
    page = Page(render_page(nothing_of(tmp_path, missing)))
    assert [section["id"] for section in page.all("section") if "id" in section] == list(SECTIONS)
    assert any(text.startswith(sentence) for text in page.texts)
    assert "nan" not in " ".join(page.texts).lower().split()
    if missing == "readings":
        assert "keypoints off by 3.0 px on average" in page.texts


def test_a_page_is_written_whole_or_not_at_all(tmp_path, without_study):
    told = nothing_of(tmp_path, "predictions")
    path = tmp_path / "out" / "report.html"
    write_page(told, path)
    before = path.read_bytes()
    assert before.decode() != ""
    told.frames[1].image_path.unlink()
    with pytest.raises((OSError, ValueError), match=r"1\.png"):
        write_page(told, path)
    assert path.read_bytes() == before
    assert [found.name for found in path.parent.iterdir()] == ["report.html"]


def test_the_templates_are_shipped(root):
    import tomllib

    shipped = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    others = {path for path in (root / "usvnet").rglob("*.*") if path.suffix not in {".py", ".pyc"}}
    found = {p for room, globs in shipped.items() for g in globs for p in root.glob(f"{room.replace('.', '/')}/{g}")}
    assert others <= found


def test_a_picture_of_several_boats_shows_its_worst(tmp_path):
    frame, other = evaluation(tmp_path, 2, lambda n, of: [], lambda n: [truth(range_m=10.0)]).frames
    errors = [(frame, 0.1), (frame, -9.0), (other, 5.0), (frame, math.inf), (other, math.inf)]
    examples = [Example(of, truth(range_m=10.0 + n), None, error) for n, (of, error) in enumerate(errors)]
    assert [example.error for example in worst_examples(examples)] == [-9.0, 5.0]
    assert [example.error for example in worst_examples(examples[:3])][:1] == [-9.0]
    assert [example.frame.name for example in missed_examples(examples)] == [frame.name, other.name]
