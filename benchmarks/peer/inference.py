"""Time the peer when asked: reads ``SIZE COUNT`` a line, answers ``RESULT {"network_ms": [...], "chain_ms": [...]}``.

PEER/bin/python benchmarks/peer/inference.py --model yolo11n-pose.yaml --settings FOLDER

The network is the peer's with its norms folded in and channels_last weights; the chain is its ``predict`` on a picture
in memory.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import torch
from environment import open_ultralytics


def main() -> None:
    """Answer until the input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True)
    parser.add_argument("--settings", type=Path, required=True)
    options = parser.parse_args()
    peer = open_ultralytics(options.settings)
    torch.manual_seed(0)
    chain = peer.YOLO(options.model, task="pose")
    network = (
        peer.YOLO(options.model, task="pose").model.fuse(verbose=False).eval().to(memory_format=torch.channels_last)
    )
    for line in sys.stdin:
        size_px, count = map(int, line.split())
        image = torch.rand(1, 3, size_px, size_px).to(memory_format=torch.channels_last)
        picture = np.random.default_rng(0).integers(0, 256, (size_px, size_px, 3), np.uint8)
        times: dict[str, list[float]] = {"network_ms": [], "chain_ms": []}
        with torch.inference_mode():
            for _ in range(count):
                start_s = time.perf_counter()
                network(image)
                times["network_ms"].append(1000 * (time.perf_counter() - start_s))
        for _ in range(count):
            start_s = time.perf_counter()
            chain.predict(picture, imgsz=size_px, conf=0.001, max_det=20, device="cpu", verbose=False)
            times["chain_ms"].append(1000 * (time.perf_counter() - start_s))
        print("RESULT " + json.dumps(times), flush=True)


if __name__ == "__main__":
    main()
