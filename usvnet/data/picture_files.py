"""Which files a person means by a picture's name, a folder, a pattern or a video's name."""

import re
from contextlib import suppress
from glob import glob
from pathlib import Path, PurePath
from typing import NamedTuple

import cv2

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
VIDEO_SUFFIXES = (
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".ts", ".wmv"),
    *(".mts", ".m2ts", ".3gp", ".flv"),
)


class PictureFiles(NamedTuple):
    """Photographs, or one video."""

    paths: tuple[Path, ...]
    """Sorted, numbers by their size; at least one."""
    is_video: bool


def is_picture_name(path: PurePath) -> bool:
    """Whether a file is a picture by its name.

    Hidden files are none: macOS leaves ``._photo.jpg`` beside photographs on a card, and what is being written has such
    a name until it is whole.
    """
    return path.suffix.lower() in PICTURE_SUFFIXES and not path.name.startswith(".")


def pictures_below(folder: Path) -> list[Path]:
    """All pictures of a folder and of the folders in it, sorted."""
    return sorted(path for path in folder.rglob("*") if is_picture_name(path))


def find_picture_files(source: str) -> PictureFiles:
    """Photographs by name or by a glob, all photographs of a folder, or one video.

    Of what a glob matches only pictures and videos count, as of a folder only pictures do.

    Raises:
        FileNotFoundError: nothing there.
        ValueError: a video among several files, or what is neither a picture nor a video.
    """
    path = Path(source)
    with suppress(RuntimeError):  # ~ may begin a name
        path = path.expanduser()
    if path.is_dir():
        files = [file for file in path.iterdir() if is_picture_name(file)]
    elif path.is_file():
        files = [path]
    else:
        matches = glob(str(path), recursive=True)  # noqa: PTH207 - a pattern may be absolute, which Path.glob refuses
        files = [Path(match) for match in matches if Path(match).is_file()]
    if not files:
        what = "no pictures in the folder" if path.is_dir() else "no file matches"
        raise FileNotFoundError(f"{what} {source!r}")
    known = [file for file in files if file.suffix.lower() in PICTURE_SUFFIXES + VIDEO_SUFFIXES or _is_picture(file)]
    if not known:
        pictures, films = (", ".join(sorted(suffixes)) for suffixes in (PICTURE_SUFFIXES, VIDEO_SUFFIXES))
        raise ValueError(f"{files[0]}: neither a picture ({pictures}) nor a video ({films}), expected one of these")
    files = known
    videos = [file for file in files if file.suffix.lower() in VIDEO_SUFFIXES]
    if videos and len(files) > 1:
        raise ValueError(
            f"{source!r} matches {len(files)} files, {videos[0]} among them: give one video or only photos"
        )
    return PictureFiles(tuple(sorted(files, key=_counting)), bool(videos))


def _counting(path: Path) -> list[str | int]:
    """Sorts 2.jpg before 10.jpg, as the frames of a video are numbered."""
    return [int(part) if number % 2 else part for number, part in enumerate(re.split("([0-9]+)", str(path)))]


def _is_picture(path: Path) -> bool:
    """Whether OpenCV knows a file of another suffix by its first bytes."""
    return bool(cv2.haveImageReader(str(path)))
