"""``usvnet import-weights``."""

from pathlib import Path

import torch

from usvnet.checkpoints import MODEL_PREFIX, STAMP
from usvnet.files import atomic_write
from usvnet.pretrained.importer import ImportedWeights
from usvnet.pretrained.importer import import_weights as read_weights
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS

LICENCE_NOTE = (
    "licence: Ultralytics publishes its program and its weights under AGPL-3.0, which is not usvnet's licence: see to "
    "it before you pass on {output} or a network trained from it"
)


def import_weights(file: Path, *, output: Path) -> None:
    """Start from weights that Ultralytics trained: pose or detect networks of YOLO11, YOLOv8 or YOLOv8-P6, any size.

    The file is read without Ultralytics and without running anything in it. What fits is taken; the heatmap head,
    which that program does not have, and a last layer for other keypoints or classes are left to be trained
    (``--model.initial_weights`` of train.py).

    Args:
        file: checkpoint written by Ultralytics (.pt).
        output: checkpoint to write, for train.py, evaluate.py and ``usvnet export``.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, holds what no checkpoint needs, or a network that usvnet does not have.
    """
    if output.exists() and output.samefile(file):
        raise ValueError(f"{output}: the output is the file itself, expected another name")
    found = read_weights(file)
    weights = {MODEL_PREFIX + name: tensor for name, tensor in found.model.state_dict().items()}
    stamp = {"variant": found.variant, "curved_water": False, "image_size": None}
    with atomic_write(output) as temporary:
        torch.save({STAMP: stamp, "state_dict": weights}, temporary)
    print("\n".join(report(file, found)))
    print(f"wrote {output}: train from it with --model.variant {found.variant} --model.initial_weights {output}")
    print(LICENCE_NOTE.format(output=output))


def report(file: Path, found: ImportedWeights) -> list[str]:
    """Say what the file holds, what of it was taken and what is left to be trained."""
    keypoints = f"{found.keypoints} keypoints" if found.keypoints else "no keypoints"
    classes = f"{found.classes} class{'es' if found.classes > 1 else ''}"
    names = {"trunk": "backbone and neck", "box": "box branch", "score": "score branch", "keypoint": "keypoint branch"}
    taken = [f"{names[part]} ({got} of {whole} layers)" for part, (got, whole) in found.taken.items() if got]
    left = [f"{names[part]} ({whole - got} layers)" for part, (got, whole) in found.taken.items() if got < whole]
    lines = [
        f"{file}: variant {found.variant}, {keypoints}, {classes}; weights of its `{found.key}`",
        f"taken: {', '.join(taken)}",
        f"left as drawn, to be trained: {', '.join([*left, 'heatmap head'])}",
    ]
    if found.keypoints == NUM_KEYPOINTS:
        lines.append(f"its keypoints are taken in their order for {', '.join(KEYPOINT_NAMES)}")
    return lines
