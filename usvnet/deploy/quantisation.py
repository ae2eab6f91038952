"""Eight-bit convolutions in an OpenVINO file; everything after the network stays in float32, bit for bit.

Post-training quantisation by NNCF. It is given the network alone, cut out of the graph where the last convolutions end,
and what comes back is put in its place: heatmaps, suppression, geometry and fit are not touched, and thousands of their
small operations need not be searched for something to quantise.
"""

import contextlib
import logging
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from torch.utils.data import Subset

from usvnet.data.dataset import Sample, collate
from usvnet.deploy.runtimes import needed

CONVOLUTIONS = ("Convolution", "GroupConvolution")


def quantiser() -> ModuleType:
    """Import NNCF, which would report to its makers that it is used, and is told not to.

    Raises:
        ValueError: it is not installed.
    """
    os.environ.setdefault("NNCF_CI", "1")
    nncf = needed("nncf", extra="int8")
    nncf.set_log_level(logging.ERROR)
    return nncf


def quantise(source: Path, target: Path, samples: Subset[Sample]) -> None:
    """Write an OpenVINO file with its network quantised.

    Args:
        source: a float32 file as ``usvnet export`` writes it.
        target: the ``.xml`` to write, its weights in a ``.bin`` beside it.
        samples: pictures of the source's size, as the network sees them: they tell how large its activations get.

    Raises:
        ValueError: NNCF or OpenVINO is not installed.
    """
    openvino, nncf = needed("openvino"), quantiser()
    model = openvino.Core().read_model(source)
    joints = network_ends(model)
    network = openvino.Model([output for output, _ in joints], [model.input("image").get_node()])
    others = {node.get_type_name() for node in network.get_ops()} - {*CONVOLUTIONS}
    with contextlib.redirect_stdout(sys.stderr):  # where NNCF draws its progress
        quantised = nncf.quantize(
            network,
            nncf.Dataset(samples, lambda sample: collate([sample]).image.numpy()),
            preset=nncf.QuantizationPreset.MIXED,  # SiLU's answers lie mostly on one side of 0
            target_device=nncf.TargetDevice.CPU,
            subset_size=len(samples),
            ignored_scope=nncf.IgnoredScope(types=sorted(others), validate=False),
        )
    for (_, targets), output in zip(joints, quantised.outputs):
        answer = output.get_node().input_value(0)
        for target_input in targets:
            target_input.replace_source_output(answer)
    for first in quantised.input("image").get_target_inputs():
        first.replace_source_output(model.input("image"))
    model.validate_nodes_and_infer_types()
    openvino.save_model(model, target, compress_to_fp16=False)


def network_ends(model: Any) -> list[tuple[Any, list[Any]]]:
    """Outputs of the last convolutions, before their biases, each with the inputs outside the network that read it.

    Inside is everything that a convolution depends on. Where a feature map inside is asked for its shape, that reads it
    too.
    """
    nodes = model.get_ordered_ops()
    inside: set[str] = set()
    for node in reversed(nodes):
        if node.get_type_name() in CONVOLUTIONS or any(name in inside for name in _names_of_readers(node)):
            inside.add(node.get_name())
    ends = []
    for node in nodes:
        if node.get_name() in inside and node.get_type_name() not in ("Constant", "Parameter"):
            for output in node.outputs():
                outside = [one for one in output.get_target_inputs() if one.get_node().get_name() not in inside]
                if outside:
                    ends.append((output, outside))
    return ends


def _names_of_readers(node: Any) -> list[str]:
    return [one.get_node().get_name() for output in node.outputs() for one in output.get_target_inputs()]
