"""Write the peer's boxes and keypoints of pictures as JSON Lines, in pixels whose centres are integers.

PEER/bin/python benchmarks/peer/predict.py --weights best.pt --pictures list.txt --imgsz 640 --out predictions.jsonl

A line is ``{"picture": path, "boats": [{"box_px", "score", "keypoints_px", "visibility"}, ...]}``.
"""

import argparse
import json
from pathlib import Path

from environment import open_ultralytics

BOATS, CONFIDENCE, IOU = 20, 0.001, 0.7
"""As ours: most boats a picture, lowest score, overlap above which a box is dropped."""


def main() -> None:
    """Predict every picture of the list, one path a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("weights", "pictures", "out"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--imgsz", type=int, default=640)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    model = open_ultralytics(options.out.parent / "settings").YOLO(str(options.weights))
    lines = []
    for picture in options.pictures.read_text().splitlines():
        found = model.predict(
            picture,
            imgsz=options.imgsz,
            conf=CONFIDENCE,
            iou=IOU,
            max_det=BOATS,
            device=options.device,
            verbose=False,
        )[0]
        boats = [
            {
                "box_px": [value - 0.5 for value in box],  # the peer's pixel i covers [i, i + 1)
                "score": score,
                "keypoints_px": [[u - 0.5, v - 0.5] for u, v, _ in keypoints],
                "visibility": [visibility for *_, visibility in keypoints],
            }
            for box, score, keypoints in zip(
                found.boxes.xyxy.tolist(), found.boxes.conf.tolist(), found.keypoints.data.tolist(), strict=True
            )
        ]
        lines.append(json.dumps({"picture": picture, "boats": boats}))
    temporary = options.out.with_suffix(".part")
    temporary.write_text("\n".join(lines) + "\n")
    temporary.replace(options.out)


if __name__ == "__main__":
    main()
