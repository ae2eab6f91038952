"""Train the peer on a dataset in YOLO-pose form, from random weights, going on where it was stopped.

PEER/bin/python benchmarks/peer/train.py --data data.yaml --model yolo11n-pose.yaml --imgsz 320 --epochs 40 --out FOLDER

The best checkpoint is ``FOLDER/train/weights/best.pt``. The last line is ``RESULT {"train_img_per_s": ...}``, over the
epochs that were trained now but the first (of several); ``--fresh`` forgets an earlier run, as ``training_speed.py``
wants it.
"""

import argparse
import json
import shutil
import statistics
import time
from pathlib import Path
from typing import Any

from environment import open_ultralytics


class EpochClock:
    """Pictures a second of each training epoch, validation left out."""

    def __init__(self, model: Any) -> None:
        self.rates: list[float] = []
        model.add_callback("on_train_epoch_start", self.start)
        model.add_callback("on_train_epoch_end", self.stop)

    def start(self, trainer: Any) -> None:
        """Start the clock."""
        self.started_s = time.perf_counter()

    def stop(self, trainer: Any) -> None:
        """Stop the clock."""
        self.rates.append(len(trainer.train_loader.dataset) / (time.perf_counter() - self.started_s))


def main() -> None:
    """Train what is left to train."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, kind in (("data", Path), ("model", str), ("out", Path)):
        parser.add_argument(f"--{name}", type=kind, required=True)
    for name, value in (("imgsz", 320), ("epochs", 40), ("batch", 8), ("seed", 0), ("workers", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--fresh", action="store_true")
    options = parser.parse_args()
    out = options.out.resolve()
    ultralytics = open_ultralytics(out / "settings")
    if options.fresh:
        shutil.rmtree(out / "train", ignore_errors=True)
    last, results = out / "train" / "weights" / "last.pt", out / "train" / "results.csv"
    if results.is_file() and len(results.read_text().splitlines()) > options.epochs:  # a line an epoch, and the header
        return
    started: dict[str, Any] = {
        "data": str(options.data.resolve()),
        "imgsz": options.imgsz,
        "epochs": options.epochs,
        "batch": options.batch,
        "seed": options.seed,
        "workers": options.workers,
        "pretrained": False,
        "amp": options.device != "cpu",
        "plots": False,
        "project": str(out),
        "name": "train",
        "exist_ok": True,
    }
    resume = last.is_file()
    model = ultralytics.YOLO(str(last) if resume else options.model, task="pose")
    clock = EpochClock(model)
    model.train(device=options.device, **({"resume": True} if resume else started))
    rate = statistics.harmonic_mean(clock.rates[1:] or clock.rates)
    print("RESULT " + json.dumps({"train_img_per_s": rate}))


if __name__ == "__main__":
    main()
