"""The networks that come along are those their cards tell of, and they work."""

import re
import statistics

import pytest

from usvnet.checkpoints import sha256
from usvnet.data import read_dataset
from usvnet.data.pictures import read_picture
from usvnet.deploy.predictor import Predictor, default_checkpoint


@pytest.mark.parametrize("refine", [False, True])
def test_it_is_small_and_the_one_of_its_card(refine):
    path = default_checkpoint(refine)
    card = path.with_suffix(".md").read_text()
    assert path.stat().st_size <= 8e6
    assert re.findall(r"\b[0-9a-f]{64}\b", card) == [sha256(path)]


@pytest.mark.parametrize("refine", [False, True])
def test_it_ranges_boats_of_the_sample(root, refine):
    errors = []
    for frame in read_dataset(root / "data" / "sample", "test")[:6]:
        boats = Predictor(default_checkpoint(refine), frame.camera)(read_picture(frame.image_path))
        measured_m = float(frame.range_m[0])
        if boats and measured_m > 0:
            errors.append(abs(boats[0].ranges["fused"].slant_m / measured_m - 1))
    assert len(errors) >= 5
    assert statistics.median(errors) < 0.05
