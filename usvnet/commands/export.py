"""``usvnet export``."""

from pathlib import Path

from usvnet.checkpoints import STAMP, load_model, read_checkpoint
from usvnet.deploy.export import export_model
from usvnet.deploy.export_int8 import Int8Data, export_int8
from usvnet.deploy.predictor import default_checkpoint
from usvnet.deploy.sidecar import sidecar_path
from usvnet.network.nms import MAX_CANDIDATES


def export(
    *,
    output: Path,
    checkpoint: Path | None = None,
    score_threshold: float = 0.25,
    max_boats: int = 20,
    int8_data: Path | None = None,
    int8_calibration_split: str = "val",
    int8_gate_split: str = "test",
    int8_tolerance_m: float = 0.02,
) -> None:
    """Write a trained model for other programs, read the file back and check that it says the same.

    Args:
        output: file to write: .ts or .pt (TorchScript), .pt2 (torch.export), .onnx (ONNX) or .xml (OpenVINO, its
            weights in a .bin beside it); described by a .json beside it.
        checkpoint: weights written by train.py; checkpoints/usvnet-n.pt where none is named.
        score_threshold: lowest score that the file marks as a boat.
        max_boats: most boats reported a picture.
        int8_data: dataset folder with laser ranges: the network goes into an OpenVINO file in 8 bits, fitted to some of
            these pictures, and is written only if it ranges boats of others about as well as in float32.
        int8_calibration_split: split of it whose pictures 8 bits are fitted to.
        int8_gate_split: split of it whose boats are ranged.
        int8_tolerance_m: how much greater than in float32 the mean absolute error of their fused range may be; no more
            boats may be missed in any case.

    Raises:
        FileNotFoundError: there is no such checkpoint, or no such dataset.
        ValueError: an option out of range, a checkpoint that is not one of usvnet, a library that is missing, a file
            that does not agree with it when read back, or ranges that get too much worse in int8.
    """
    if not 1 <= max_boats <= MAX_CANDIDATES:
        raise ValueError(f"max_boats: got {max_boats}, expected 1 to {MAX_CANDIDATES}")
    if not 0 <= score_threshold <= 1:
        raise ValueError(f"score_threshold: got {score_threshold:g}, expected a score from 0 to 1")
    checkpoint = checkpoint or default_checkpoint()
    stamp = read_checkpoint(checkpoint)[STAMP]
    model = load_model(checkpoint)
    model.max_boats = max_boats
    image_size = stamp.get("image_size")
    if int8_data is None:
        parity = export_model(model, output, score_threshold, image_size)
        told = (
            f"same as the checkpoint to {parity.px:.1e} px and {1000 * parity.m_at_10_m:.1e} mm at 10 m "
            "(two picture sizes, two batch sizes)"
        )
    else:
        data = Int8Data(int8_data, int8_calibration_split, int8_gate_split, int8_tolerance_m)
        told = f"on {int8_gate_split}, {export_int8(model, output, data, score_threshold, image_size)}"
    print(f"wrote {output} and {sidecar_path(output)}")
    print(told)
