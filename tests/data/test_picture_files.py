"""Which files are meant by a name, and in which order they come."""

from pathlib import Path

import pytest

from usvnet.data.picture_files import find_picture_files


def test_numbered_pictures_come_in_the_order_in_which_they_were_taken(tmp_path: Path):
    for name in ("10.jpg", "9.jpg", "1.jpg", "b2.jpg", "b10.jpg", "a3.jpg"):
        (tmp_path / name).touch()
    names = [path.name for path in find_picture_files(str(tmp_path)).paths]
    assert names == ["1.jpg", "9.jpg", "10.jpg", "a3.jpg", "b2.jpg", "b10.jpg"]
    assert [path.name for path in find_picture_files(str(tmp_path / "b*")).paths] == ["b2.jpg", "b10.jpg"]


def test_a_name_may_begin_with_a_tilde(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("~clip.mp4").touch()
    assert find_picture_files("~clip.mp4").is_video
    with pytest.raises(FileNotFoundError, match=r"no file matches '~none\.mp4'"):
        find_picture_files("~none.mp4")
