"""Write the peer's network, with random weights and our seven keypoints, as its own float32 OpenVINO export.

PEER/bin/python benchmarks/peer/export_openvino.py --model yolo11n-pose.yaml --sizes 320 640 --out FOLDER

``FOLDER/320.xml`` takes pictures (1, 3, 320, 320), and so on.
"""

import argparse
import os
from pathlib import Path

import torch
from environment import open_ultralytics

KEYPOINTS = (7, 3)


def main() -> None:
    """Export every size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True)
    parser.add_argument("--sizes", type=int, nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    out = options.out.resolve()
    peer = open_ultralytics(out / "settings")
    from ultralytics.nn.tasks import PoseModel

    os.chdir(out)  # where the peer writes
    torch.manual_seed(0)
    for size_px in options.sizes:
        whole = peer.YOLO(options.model, task="pose")
        network = PoseModel(options.model, nc=1, data_kpt_shape=KEYPOINTS, verbose=False)
        network.args, network.task = whole.model.args, whole.task
        whole.model = network
        written = Path(whole.export(format="openvino", imgsz=size_px, device="cpu", verbose=False))
        for file in written.iterdir():
            if file.suffix in (".xml", ".bin"):
                file.rename(out / f"{size_px}{file.suffix}")


if __name__ == "__main__":
    main()
