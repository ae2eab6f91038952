import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from turned_jpegs import STORED, write_turned

from usvnet.data.pictures import PictureCache, read_grey, read_picture


@pytest.fixture
def jpeg(tmp_path: Path) -> Path:
    path = tmp_path / "0001.jpg"
    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    cv2.imwrite(str(path), cv2.GaussianBlur(picture, (0, 0), 3))
    return path


def test_colours_come_as_rgb(tmp_path: Path):
    red = np.zeros((8, 8, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes BGR
    cv2.imwrite(str(tmp_path / "red.png"), red)
    np.testing.assert_array_equal(read_picture(tmp_path / "red.png")[4, 4], [255, 0, 0])


def test_a_grey_picture_gets_three_channels(tmp_path: Path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((8, 8), 90, np.uint8))
    np.testing.assert_array_equal(read_picture(tmp_path / "grey.png")[4, 4], [90, 90, 90])


@pytest.mark.parametrize("orientation", STORED)
def test_photographs_stand_upright_as_their_exif_orientation_says(tmp_path: Path, orientation: int):
    v, u = np.mgrid[:48, :64]
    upright = np.stack([u + 90, u + v + 60, 3 * v + 20], -1).astype(np.uint8)
    write_turned(tmp_path / "phone.jpg", upright, orientation)
    np.testing.assert_allclose(read_picture(tmp_path / "phone.jpg")[..., ::-1].astype(int), upright, atol=5)
    grey = cv2.cvtColor(upright, cv2.COLOR_BGR2GRAY)
    np.testing.assert_allclose(read_grey(tmp_path / "phone.jpg").astype(int), grey, atol=3)


@pytest.mark.parametrize("keep", [0, 0.01, 0.3, 0.6, 0.999])
def test_a_jpeg_cut_short_is_refused(jpeg: Path, keep: float):
    data = jpeg.read_bytes()
    jpeg.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(ValueError, match=r"0001\.jpg: corrupt"):
        read_picture(jpeg)


def test_something_else_named_jpeg_is_refused(jpeg: Path):
    jpeg.write_bytes(b"<html>not found</html>")
    with pytest.raises(ValueError, match=r"0001\.jpg: corrupt picture"):
        read_picture(jpeg)


def test_a_jpeg_with_something_behind_it_is_read(jpeg: Path):
    expected = read_picture(jpeg)
    data = jpeg.read_bytes()
    for behind in (b"camera maker's notes", b"a film that holds \xff\xda, too"):
        jpeg.write_bytes(data + behind)
        np.testing.assert_array_equal(read_picture(jpeg), expected)


def test_a_jpeg_whose_thumbnail_ends_is_not_whole(jpeg: Path):
    data = jpeg.read_bytes()
    thumbnail = b"\xff\xe1" + (2 + len(data)).to_bytes(2) + data  # within a segment, as EXIF has it
    whole = data[:2] + thumbnail + data[2:]
    jpeg.write_bytes(whole)
    assert read_picture(jpeg).size > 0
    jpeg.write_bytes(whole[: 4 + len(thumbnail) + 20])
    with pytest.raises(ValueError, match="corrupt JPEG"):
        read_picture(jpeg)


def test_a_missing_picture_is_named(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.jpg: no such picture"):
        read_picture(tmp_path / "nowhere.jpg")


def test_a_picture_of_another_size_than_its_camera_is_refused(jpeg: Path):
    with pytest.raises(ValueError, match=r"0001\.jpg: picture of 64 x 48, expected 640 x 480 as its camera"):
        PictureCache(1, 1000).read(jpeg, (640, 480))
    with pytest.raises(ValueError, match=r"0001\.jpg: picture of 64 x 48 \(turned by 90 degrees\?\), expected 48 x 64"):
        PictureCache(1, 1000).read(jpeg, (48, 64))


def test_the_cache_keeps_pictures_small_within_its_budget_and_in_its_own_process(tmp_path: Path):
    paths = [tmp_path / f"{i}.png" for i in range(3)]
    for path in paths:
        cv2.imwrite(str(path), np.zeros((600, 800, 3), np.uint8))
    cache = PictureCache(budget_mb=1, longest_px=400)  # 400 x 300 x 3 bytes each: two fit
    assert all(cache.read(path, (800, 600)).shape == (300, 400, 3) for path in paths)
    assert len(cache.kept) == 2
    paths[0].unlink()
    paths[2].unlink()
    assert cache.read(paths[0], (800, 600)).shape == (300, 400, 3)
    with pytest.raises(FileNotFoundError):
        cache.read(paths[2], (800, 600))
    copy = pickle.loads(pickle.dumps(cache))
    assert len(copy.kept) == 0
    assert copy.left_bytes == 2**20
