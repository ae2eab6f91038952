"""A dataset of a few pictures of the sample set."""

import csv
from pathlib import Path


def write_small_sample(sample: Path, folder: Path, pictures: dict[str, int]) -> None:
    """Link the first pictures of each split (split -> how many), and list them only."""
    kept = []
    for name in ("cameras", "data.yaml", "hulls"):
        (folder / name).symlink_to(sample / name)
    for split, count in pictures.items():
        for picture in sorted((sample / "images" / split).iterdir())[:count]:
            for file in (Path("images", split, picture.name), Path("labels", split, f"{picture.stem}.txt")):
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (folder / file).symlink_to(sample / file)
            kept.append(f"{split}/{picture.name}")
    for name in ("frames.csv", "ranges.csv"):
        header, *rows = csv.reader((sample / name).open())
        with (folder / name).open("w", newline="") as stream:
            csv.writer(stream).writerows([header, *(row for row in rows if row[0] in kept)])
