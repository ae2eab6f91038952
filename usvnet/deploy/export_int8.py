"""Writing a model with eight-bit convolutions, which gets its name only where its ranges are about as good."""

import json
import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from torch.utils.data import Subset

from usvnet.data.dataset import BoatDataset, Sample
from usvnet.data.reader import read_dataset
from usvnet.deploy.deployed import DeployedUSVNet
from usvnet.deploy.export import draft_of
from usvnet.deploy.formats import FORMATS, check_takes, write_openvino
from usvnet.deploy.gate import Gate, measure
from usvnet.deploy.parity import check_parity
from usvnet.deploy.predictor import DEFAULT_IMAGE_SIZE_PX
from usvnet.deploy.quantisation import quantise, quantiser
from usvnet.deploy.runtimes import needed, open_runtime
from usvnet.deploy.sidecar import describe, sidecar_path
from usvnet.model import USVNet

SUFFIX = ".xml"
CALIBRATION_PICTURES = 100
"""At most so many tell how large activations get, evenly spread over their split."""


class Int8Data(NamedTuple):
    """The pictures that eight bits are fitted to and judged on, and how much worse ranges may be."""

    root: Path
    """Dataset folder."""
    calibration_split: str = "val"
    """Its labels are not used."""
    gate_split: str = "test"
    """Boats of it that have a laser range are judged."""
    tolerance_m: float = 0.02
    """How much greater the mean absolute error of ``fused`` may be than in float32."""

    def check(self) -> None:
        """Insist on a tolerance that is one, and on judging by other pictures.

        Raises:
            ValueError: got something else.
        """
        if not (0 <= self.tolerance_m < math.inf):
            raise ValueError(f"int8_tolerance_m: got {self.tolerance_m:g}, expected metres from 0")
        if self.calibration_split == self.gate_split:
            raise ValueError(
                f"int8_gate_split: got {self.gate_split}, which 8 bits are fitted to, expected another one"
            )


def export_int8(
    model: USVNet, path: Path | str, data: Int8Data, score_threshold: float = 0.25, image_size: int | None = None
) -> Gate:
    """Write ``model`` for OpenVINO with its convolutions in int8, measure it, and write the sidecar beside it.

    Args:
        model: a trained model; it is not changed.
        path: of the file, which ends with ``.xml``.
        data: what it is fitted to and judged on.
        score_threshold: lowest score that the file marks as a boat.
        image_size: side of the pictures that the model was trained on.

    Returns:
        What was measured.

    Raises:
        FileNotFoundError: no such dataset.
        ValueError: another suffix, a library that is not installed, faulty data or none with ranges, a float32 file
            that differs from the model, or ranges that int8 makes too much worse. No file is left in that case.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise ValueError(f"{path}: got the suffix {path.suffix!r}, expected {SUFFIX}: int8 is for OpenVINO")
    check_takes(path, model)
    data.check()
    versions = {
        package.__name__: package.__version__
        for package in (quantiser(), *(needed(name, "int8") for name in FORMATS[SUFFIX].packages))
    }
    size_px = image_size or DEFAULT_IMAGE_SIZE_PX
    samples = spread_out(BoatDataset(read_dataset(data.root, data.calibration_split), size_px), CALIBRATION_PICTURES)
    labelled = BoatDataset(read_dataset(data.root, data.gate_split), size_px)
    if not any((frame.range_m > 0).any() for frame in labelled.frames):
        raise ValueError(f"{data.root}: no boat of {data.gate_split} has a range in ranges.csv to judge int8 by")
    deployed = DeployedUSVNet(model, score_threshold).eval()
    float32 = measure(deployed, labelled, score_threshold, "measuring float32")
    if float32.missed == float32.boats:
        raise ValueError(f"{data.root}: no boat of {data.gate_split} is ranged in float32, to judge int8 by")
    with draft_of(path) as draft, tempfile.TemporaryDirectory() as aside:
        whole = Path(aside) / draft.name
        write_openvino(deployed, whole, size_px)
        parity = check_parity(model, deployed, open_runtime(whole))
        quantise(whole, draft, samples)
        int8 = measure(open_runtime(draft), labelled, score_threshold, "measuring int8")
        gate = Gate(float32, int8, data.tolerance_m)
        gate.check()
        made = {
            "quantised": "the network's convolutions to 8 bits; all else is float32",
            "calibration": {"split": data.calibration_split, "pictures": len(samples)},
            "measured": {"split": data.gate_split, **gate.to_json()},
            "made_with": versions,
        }
        about = describe(model, draft, score_threshold, image_size)
        about |= {"parity_before_quantisation": parity._asdict(), "int8": made}
        sidecar_path(draft).write_text(json.dumps(about, indent=2) + "\n")
    return gate


def spread_out(dataset: BoatDataset, most: int) -> Subset[Sample]:
    """At most so many samples of a dataset, evenly spread: neighbours are often alike."""
    return Subset(dataset, np.linspace(0, len(dataset) - 1, min(len(dataset), most)).round().astype(int).tolist())
