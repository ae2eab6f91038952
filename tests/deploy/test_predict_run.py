"""Frames are counted, timed and let go."""

import os
import signal
import weakref

import cv2
import numpy as np
import pytest
from evaluation.boats import boat, truth

from usvnet.deploy import sources
from usvnet.deploy.outputs import Outputs
from usvnet.deploy.predictor import fit_camera
from usvnet.deploy.run import batches, predict_source, stopped_by_signals
from usvnet.deploy.sources import Frame, open_files
from usvnet.geometry.camera import make_camera

SIZE_PX = (64, 48)
CAMERA = make_camera([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]], SIZE_PX, height_m=1.5, pitch_rad=0.1)


class FakePredictor:
    """Finds one boat in every picture, as many metres away as the picture is grey."""

    def __init__(self):
        self.batch_sizes = []

    def native_camera(self, width, height):
        return fit_camera(CAMERA, width, height)

    def predict(self, pictures, cameras):
        self.batch_sizes.append(len(pictures))
        return [[boat(truth(range_m=float(picture[0, 0, 0])))] for picture in pictures]


class FakeOutputs(Outputs):
    def __init__(self):
        super().__init__({})
        self.names = []

    def write(self, found):
        self.names.append(found.frame.name)


def make_folder(folder, count, size_px=SIZE_PX):
    for number in range(count):
        picture = np.full((size_px[1], size_px[0], 3), 10 + number, np.uint8)
        cv2.imwrite(str(folder / f"{number:02d}.png"), picture)
    return folder


def run(source, told, predictor=None, **options):
    outputs = FakeOutputs()
    tally = predict_source(source, predictor or FakePredictor(), outputs, "waterline", told.append, **options)
    return tally, outputs.names


def test_everything_is_counted(tmp_path):
    told = []
    folder = make_folder(tmp_path, 5)
    (folder / "03.png").write_bytes(b"damaged")
    source = open_files(str(folder), told.append)
    tally, names = run(source, told)
    assert names == ["00.png", "01.png", "02.png", "04.png"]
    assert (tally.frames, tally.boats, tally.ranged, tally.misfits) == (4, 4, 4, 0)
    assert (tally.nearest_m, tally.farthest_m) == (10.0, 14.0)
    assert source.losses.unreadable == 1
    assert all(seconds > 0 for seconds in tally.seconds.values())
    assert sum(tally.seconds.values()) <= tally.frames / tally.frames_per_s


def test_a_picture_of_another_shape_is_skipped_unless_it_is_the_first(tmp_path):
    told = []
    folder = make_folder(tmp_path, 4)
    cv2.imwrite(str(folder / "02.png"), np.zeros((64, 64, 3), np.uint8))
    tally, names = run(open_files(str(folder), told.append), told)
    assert names == ["00.png", "01.png", "03.png"]
    assert tally.misfits == 1
    assert len(told) == 1
    assert told[0].startswith("skipped 02.png: ")
    cv2.imwrite(str(folder / "00.png"), np.zeros((64, 64, 3), np.uint8))
    with pytest.raises(ValueError, match="another shape"):
        run(open_files(str(folder), told.append), told)


@pytest.mark.parametrize(("most", "names"), [(1, ["00.png"]), (3, ["00.png", "01.png", "02.png"])])
def test_at_most_so_many_frames(tmp_path, most, names):
    folder = make_folder(tmp_path, 5)
    assert run(open_files(str(folder), print), [], max_frames=most, batch_size=2)[1] == names


def test_batches_are_neighbours_of_one_size():
    sides = [4, 4, 4, 6, 6, 4]
    frames = [Frame(str(n), n, None, np.zeros((side, side, 3), np.uint8)) for n, side in enumerate(sides)]
    assert [[frame.number for frame in batch] for batch in batches(frames, 2)] == [[0, 1], [2], [3, 4], [5]]


@pytest.mark.parametrize("batch_size", [1, 3])
def test_frames_are_let_go(tmp_path, monkeypatch, batch_size):
    read, handed_out, alive = sources.read_picture, [], []

    def reading(path):
        picture = read(path)
        handed_out.append(weakref.ref(picture))
        alive.append(sum(picture() is not None for picture in handed_out))
        return picture

    monkeypatch.setattr(sources, "read_picture", reading)
    predictor = FakePredictor()
    run(open_files(str(make_folder(tmp_path, 30)), print), [], predictor, batch_size=batch_size)
    assert len(alive) == 30
    assert max(alive) <= 2 * batch_size
    assert predictor.batch_sizes == [batch_size] * (30 // batch_size)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_after_the_frame(tmp_path, number):
    source = open_files(str(make_folder(tmp_path, 9)), print)
    before = signal.getsignal(number)

    def watch(tally):
        if tally.frames == 3:
            os.kill(os.getpid(), number)

    with stopped_by_signals(source) as signals:
        tally, _ = run(source, [], watch=watch)
    assert tally.frames == 3
    assert signals == [number]
    assert signal.getsignal(number) is before
