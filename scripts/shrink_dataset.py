"""Make a small dataset of a large one: fewer pictures, evenly over scenes and cameras, and smaller ones.

Example: python scripts/shrink_dataset.py LARGE SMALL --size 320 --train 120 --val 30 --test 24 --quality 80
"""

import argparse
import csv
import itertools
import shutil
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np

from usvnet.data.formats.ranges import REFERENCES, FrameNotes, read_tables
from usvnet.data.formats.yolo import write_data_yaml, write_yolo
from usvnet.data.pictures import read_picture
from usvnet.data.reader import read_cameras, read_dataset
from usvnet.data.records import SPLITS, Faults, Frame
from usvnet.files import atomic_write, run_program
from usvnet.geometry.camera import scale_camera
from usvnet.geometry.camera_files import save_camera


def choose(frames: list[Frame], notes: dict[str, FrameNotes], number: int, rng: np.random.Generator) -> list[Frame]:
    """Choose frames evenly over scenes, in each scene evenly over cameras, those with a laser range first."""
    groups: dict[str, dict[str, list[Frame]]] = defaultdict(lambda: defaultdict(list))
    for i in rng.permutation(len(frames)):
        groups[frames[i].scene or ""][notes[frames[i].name].camera or ""].append(frames[i])
    queues = [_in_turn(cameras) for _, cameras in sorted(groups.items())]
    rounds = itertools.chain.from_iterable(itertools.zip_longest(*queues))
    chosen = [frame for frame in rounds if frame is not None][:number]
    if len(chosen) < number:
        raise ValueError(f"{len(chosen)} pictures in a split, expected at least the {number} asked for")
    return sorted(chosen, key=lambda frame: frame.name)


def _in_turn(cameras: dict[str, list[Frame]]) -> list[Frame]:
    """One frame of each camera in turn, all frames with a range before those without."""
    queues = [sorted(frames, key=lambda frame: not (frame.range_m > 0).any()) for _, frames in sorted(cameras.items())]
    turns = [frame for frame in itertools.chain.from_iterable(itertools.zip_longest(*queues)) if frame is not None]
    return sorted(turns, key=lambda frame: not (frame.range_m > 0).any())


def shrunk_size(size_px: tuple[int, int], longest_px: int) -> tuple[int, int]:
    """The size (width, height) of a picture whose longer side becomes ``longest_px``."""
    scale = longest_px / max(size_px)
    return round(size_px[0] * scale), round(size_px[1] * scale)


def write_picture(frame: Frame, path: Path, longest_px: int, quality: int) -> None:
    """Write a picture smaller, averaged over areas, as JPEG."""
    small = cv2.resize(
        read_picture(frame.image_path), shrunk_size(frame.size_px, longest_px), interpolation=cv2.INTER_AREA
    )
    done, data = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"{path}: OpenCV cannot write it")
    with atomic_write(path) as temporary:
        temporary.write_bytes(data.tobytes())


def write_tables(frames: list[Frame], notes: dict[str, FrameNotes], target: Path) -> None:
    """Write frames.csv and ranges.csv of the chosen frames."""
    reference_names = {index: name for name, index in REFERENCES.items()}
    tables: dict[str, list[list[object]]] = {
        "frames.csv": [["image", "scene", "camera", "pitch_deg", "roll_deg"]],
        "ranges.csv": [["image", "range_m", "range_std_m", "instance", "reference"]],
    }
    for frame in frames:
        note = notes[frame.name]
        tables["frames.csv"].append([frame.name, note.scene, note.camera, note.pitch_deg, note.roll_deg])
        for reading in note.readings.values():
            reference = reference_names[reading.reference]
            tables["ranges.csv"].append([frame.name, reading.range_m, reading.range_std_m, reading.instance, reference])
    for name, rows in tables.items():
        with atomic_write(target / name) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows)


def main() -> None:
    """Read the arguments and write the small dataset."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=Path, help="the large dataset, the folder that holds data.yaml")
    parser.add_argument("target", type=Path, help="the small dataset; files of the same name are replaced")
    parser.add_argument("--size", type=int, default=320, help="longer side of the small pictures, px")
    parser.add_argument("--quality", type=int, default=80, help="JPEG quality, 1 to 100")
    parser.add_argument("--seed", type=int, default=0, help="the same seed chooses the same pictures")
    for split in SPLITS:
        parser.add_argument(f"--{split}", type=int, default=24, help=f"number of pictures in {split}")
    arguments = parser.parse_args()
    source, target = arguments.source, arguments.target

    rng = np.random.default_rng(arguments.seed)
    notes = defaultdict(FrameNotes, read_tables(source, Faults()))
    chosen: list[Frame] = []
    for split in SPLITS:
        chosen += choose(read_dataset(source, split), notes, getattr(arguments, split), rng)
    for frame in chosen:
        write_picture(frame, target / "images" / frame.name, arguments.size, arguments.quality)
    write_yolo(chosen, target / "labels")
    write_tables(chosen, notes, target)
    for name, camera in read_cameras(source / "cameras", Faults()).items():
        width, height = camera.size_px[0].int().tolist()
        small = scale_camera(camera, shrunk_size((width, height), arguments.size))
        save_camera(small, target / "cameras" / f"{name}.yaml", name=name)
    for hull in sorted((source / "hulls").glob("*.yaml")):
        (target / "hulls").mkdir(parents=True, exist_ok=True)
        shutil.copyfile(hull, target / "hulls" / hull.name)
    write_data_yaml(target / "data.yaml", {split: f"images/{split}" for split in SPLITS})


if __name__ == "__main__":
    run_program(main)
