"""``usvnet export``."""

from pathlib import Path

from usvnet.checkpoints import STAMP, load_model, read_checkpoint
from usvnet.deploy.export import export_model
from usvnet.deploy.sidecar import sidecar_path


def export(*, checkpoint: Path, output: Path, score_threshold: float = 0.25, max_boats: int = 20) -> None:
    """Write a trained model for other programs, read the file back and check that it says the same.

    Args:
        checkpoint: weights written by train.py.
        output: file to write: .ts or .pt (TorchScript), .pt2 (torch.export), .onnx (ONNX) or .xml (OpenVINO, its
            weights in a .bin beside it); described by a .json beside it.
        score_threshold: lowest score that the file marks as a boat.
        max_boats: most boats reported a picture.

    Raises:
        FileNotFoundError: there is no such checkpoint.
        ValueError: it is not one of usvnet, a library is missing, or the exported file does not agree with it.
    """
    stamp = read_checkpoint(checkpoint)[STAMP]
    model = load_model(checkpoint)
    model.max_boats = max_boats
    parity = export_model(model, output, score_threshold, stamp.get("image_size"))
    print(f"wrote {output} and {sidecar_path(output)}")
    print(
        f"same as the checkpoint to {parity.px:.1e} px and {1000 * parity.m_at_10_m:.1e} mm at 10 m "
        f"(two picture sizes, two batch sizes)"
    )
