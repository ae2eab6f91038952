"""The network that comes along is the one its card tells of, and it works."""

import re
import statistics

from usvnet.checkpoints import sha256
from usvnet.data import read_dataset
from usvnet.data.pictures import read_picture
from usvnet.deploy.predictor import Predictor, default_checkpoint


def test_it_is_small_and_the_one_of_its_card():
    path = default_checkpoint()
    card = path.with_suffix(".md").read_text()
    assert path.stat().st_size <= 8e6
    assert re.findall(r"\b[0-9a-f]{64}\b", card) == [sha256(path)]


def test_it_ranges_boats_of_the_sample(root):
    errors = []
    for frame in read_dataset(root / "data" / "sample", "test")[:6]:
        boats = Predictor(default_checkpoint(), frame.camera)(read_picture(frame.image_path))
        measured_m = float(frame.range_m[0])
        if boats and measured_m > 0:
            errors.append(abs(boats[0].ranges["fused"].slant_m / measured_m - 1))
    assert len(errors) >= 5
    assert statistics.median(errors) < 0.05
