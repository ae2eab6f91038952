"""Train the peer on a dataset in YOLO-pose form, from random weights, going on where it was stopped.

PEER/bin/python benchmarks/peer/train.py --data data.yaml --model yolo11n-pose.yaml --imgsz 320 --epochs 40 --out FOLDER

The best checkpoint is ``FOLDER/train/weights/best.pt``.
"""

import argparse
from pathlib import Path

from environment import open_ultralytics


def main() -> None:
    """Train what is left to train."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, kind in (("data", Path), ("model", str), ("out", Path)):
        parser.add_argument(f"--{name}", type=kind, required=True)
    for name, value in (("imgsz", 320), ("epochs", 40), ("batch", 8), ("seed", 0), ("workers", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    out = options.out.resolve()
    ultralytics = open_ultralytics(out / "settings")
    last = out / "train" / "weights" / "last.pt"
    if last.is_file():
        ultralytics.YOLO(str(last)).train(resume=True, device=options.device)
        return
    ultralytics.YOLO(options.model, task="pose").train(
        data=str(options.data.resolve()),
        imgsz=options.imgsz,
        epochs=options.epochs,
        batch=options.batch,
        seed=options.seed,
        workers=options.workers,
        device=options.device,
        pretrained=False,
        amp=options.device != "cpu",
        plots=False,
        project=str(out),
        name="train",
        exist_ok=True,
    )


if __name__ == "__main__":
    main()
