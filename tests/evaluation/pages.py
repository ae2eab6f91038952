"""Reading a page as a browser would, and evaluations to write one of."""

from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np

from usvnet.data.records import Frame
from usvnet.evaluation.html.page import Evaluation
from usvnet.evaluation.records import BoatRecord, TruthRecord
from usvnet.evaluation.scores import score
from usvnet.geometry.camera import make_camera

from .boats import boat, truth

VOID = {"meta", "img", "br", "link", "hr", "input"}
SIZE_PX = (320, 280)
NASTY_NAME, NASTY_SCENE = "<script>alert('name')</script>.jpg", '<script>"$x\\frac{'


class Page(HTMLParser):
    """Elements with their attributes and texts; end tags must fit."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> where another element is open"

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append(" ".join(data.split()))

    def all(self, tag: str) -> list[dict[str, str]]:
        """The attributes of every such element."""
        return [attributes for name, attributes in self.elements if name == tag]


def evaluation(
    folder: Path,
    pictures: int,
    predict: Callable[[int, TruthRecord], list[BoatRecord]],
    label: Callable[[int], list[TruthRecord]],
) -> Evaluation:
    """Pictures in ``folder``, labelled and predicted as the two functions of their number say."""
    generator = np.random.default_rng(0)
    camera = make_camera(
        [[400.0, 0, 159.5], [0, 400.0, 139.5], [0, 0, 1]], SIZE_PX, height_m=1.5, pitch_rad=0.1, pitch_std_rad=0.001
    )
    truths = [label(n) for n in range(pictures)]
    frames = []
    for n, labelled in enumerate(truths):
        path = folder / f"{n}.png"
        cv2.imwrite(str(path), generator.integers(60, 120, (*SIZE_PX[::-1], 3), dtype=np.uint8))
        frames.append(
            Frame(
                image_path=path,
                name=f"test/{n:02d}.jpg" if n else NASTY_NAME,
                scene=labelled[0].scene if labelled else None,
                camera=camera,
                boxes_px=np.array([t.box_px for t in labelled]).reshape(-1, 4),
                keypoints_px=np.array([t.keypoints_px for t in labelled]).reshape(-1, 7, 2),
                visibility=np.array([t.visibility for t in labelled], np.int64).reshape(-1, 7),
                range_m=np.array([t.range_m for t in labelled]),
                range_std_m=np.array([t.range_std_m for t in labelled]),
                reference=np.full(len(labelled), -1),
            )
        )
    records = [predict(n, labelled[0]) if labelled else [] for n, labelled in enumerate(truths)]
    return Evaluation(
        model="usvnet-n",
        frames=frames,
        records=records,
        truths=truths,
        scores=score(records, truths),
        curved_water=False,
        made_with={"checkpoint": "best.ckpt", "checkpoint_sha256": "abc123", "torch": "2.99", "split": "test"},
        configuration="data:\n  root: <my boats>\n",
    )


def fifteen_boats(folder: Path) -> Evaluation:
    """Errors of 0.1 m times the picture's number, alternately too far and too near; the last two are missed."""

    def label(n: int) -> list[TruthRecord]:
        return [truth(range_m=8.0 + n, scene=("I", "IV", None)[n % 3] if n else NASTY_SCENE)]

    def predict(n: int, of: TruthRecord) -> list[BoatRecord]:
        return [] if n >= 13 else [boat(of, slant_m=of.range_m + 0.1 * n * (-1) ** n, error_px=0.1 * n)]

    return evaluation(folder, 15, predict, label)


def nothing_of(folder: Path, what: str) -> Evaluation:
    """An evaluation that lacks ``pictures``, ``labels``, ``readings`` or ``predictions``."""
    if what == "pictures":
        return evaluation(folder, 0, lambda n, of: [], lambda n: [])
    if what == "labels":
        return evaluation(folder, 2, lambda n, of: [], lambda n: [])
    if what == "readings":
        return evaluation(folder, 2, lambda n, of: [boat(of, error_px=2.0 + n)], lambda n: [truth()])
    return evaluation(folder, 2, lambda n, of: [], lambda n: [truth(range_m=10.0, scene="I")])
