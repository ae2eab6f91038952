"""Opens Ultralytics (AGPL-3.0), which these scripts measure in an environment of its own.

Its environment, PEER in the commands of these scripts, is made by ``python3 -m venv PEER`` and PEER/bin/pip install of
torch==2.13.0 numpy opencv-python-headless pillow pyyaml matplotlib requests psutil polars nvidia-ml-py
ultralytics-thop==2.2.3 ultralytics-platform==0.1.99, then --no-deps ultralytics==8.4.190 torchvision==0.28.0.
"""

import os
from pathlib import Path
from typing import Any

import torch


def open_ultralytics(folder: Path) -> Any:
    """Import the package offline, with its settings in ``folder``."""
    os.environ.update(YOLO_OFFLINE="true", YOLO_AUTOINSTALL="false", YOLO_CONFIG_DIR=str(folder.resolve()))
    folder.mkdir(parents=True, exist_ok=True)
    stand_in_for_torchvision()
    import ultralytics

    ultralytics.settings.update({"sync": False, "tensorboard": False})
    return ultralytics


def stand_in_for_torchvision() -> None:
    """Declare torchvision's operators where its library was built for another PyTorch and cannot be loaded."""
    try:
        import torchvision

        return
    except RuntimeError:  # "operator torchvision::nms does not exist"
        pass
    library = torch.library.Library("torchvision", "DEF")
    for operator in ("nms", "qnms"):
        library.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    library.impl("nms", suppress, "CPU")
    stand_in_for_torchvision.library = library  # type: ignore[attr-defined]  # operators go with their library
    import torchvision
    import torchvision.extension

    torchvision.extension._has_ops = lambda: True
    torchvision.ops.boxes._assert_has_ops = lambda: None


def suppress(boxes: torch.Tensor, scores: torch.Tensor, iou_threshold: float) -> torch.Tensor:
    """Non-maximum suppression of boxes (N, 4): indices of those kept, best first."""
    order = scores.argsort(descending=True, stable=True)
    sorted_boxes = boxes[order]
    sides = (sorted_boxes[:, 2:] - sorted_boxes[:, :2]).clamp(min=0)
    area = sides.prod(1)
    free = torch.ones(len(order), dtype=torch.bool)
    kept = []
    for i in range(len(order)):
        if free[i]:
            kept.append(i)
            low = torch.maximum(sorted_boxes[i, :2], sorted_boxes[i + 1 :, :2])
            high = torch.minimum(sorted_boxes[i, 2:], sorted_boxes[i + 1 :, 2:])
            shared = (high - low).clamp(min=0).prod(1)
            free[i + 1 :] &= shared <= iou_threshold * (area[i] + area[i + 1 :] - shared)
    return order[torch.tensor(kept, dtype=torch.long)]
