"""Does the exported file say what the model said? Compared at two picture sizes and two batch sizes.

In steps, since a choice between two equal scores may tip by one rounding error, which is no error of the export: the
network with folded normalisation against the model, before anything is chosen; then the whole chain read from the file
against the same chain in memory, boat by boat, nearly all of which must be in both. There the fit of a hull, which
means nothing on most boats of a random picture, is compared on those that it happens to fit; and, scripted, on boats
that are ones.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from usvnet.deploy.deployed import ESTIMATORS, DeployedUSVNet, plain_inputs
from usvnet.deploy.probes import probe_camera, probe_native
from usvnet.geometry.camera import project
from usvnet.geometry.hull_model import generic_hull
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rotation
from usvnet.heatmap import HEATMAP_STRIDE, SIGMA_CELLS, decode
from usvnet.model import USVNet
from usvnet.types import Camera, Native

BATCH_AND_SIZE = ((1, 3, 4), (2, 3, 4), (1, 6, 5), (2, 6, 5))
"""Batch, height and width of the pictures compared, the latter two in the network's largest strides."""
TOLERANCE_PX = 0.01
TOLERANCE_M = 0.001
"""At 10 m. A pixel's worth of range grows with the square of the range, and so does what is tolerated."""
TOLERANCE_REST = 1e-4
"""Relative or absolute, for scores and everything else."""
REFERENCE_RANGE_M = 10.0
PROBE_BOATS_M = ((-0.5, 5.0, 0.3), (0.0, 7.0, 2.0), (1.0, 10.0, -2.5), (2.0, 12.0, 1.2), (-3.0, 15.0, -0.8))
"""Right of the camera, ahead of it, and heading (rad) of the boats that are fitted."""
OF_FITS = ("hull", "fused", "heading", "misfit")
SAME_BOAT_PX = 1.0
"""Boats whose boxes are this near to each other, summed over the four sides, are the same."""
LEAST_SHARED = 0.9
"""Share of the boats that must be in both answers."""
FITTING = 0.5
"""Misfit up to which a random boat counts as one."""
Answer = Callable[..., dict[str, Tensor]]
"""From the plain inputs to the named outputs: a module, or a file read back."""


class Parity(NamedTuple):
    """The greatest differences found."""

    px: float
    """Of boxes and keypoints."""
    m_at_10_m: float
    """Of ranges and positions, scaled to 10 m."""
    rest: float
    """Of everything else, relative above 1."""


def check_parity(model: USVNet, deployed: DeployedUSVNet, reloaded: Answer) -> Parity:
    """Compare a file with the model that it was made from.

    Args:
        model: as trained, in evaluation mode.
        deployed: the module that was written, made from ``model``.
        reloaded: what was read back from the file.

    Raises:
        ValueError: out of tolerance, with the figures.
    """
    generator = torch.Generator().manual_seed(0)
    worst = Parity(0.0, 0.0, 0.0)
    with torch.inference_mode():
        for batch, rows, columns in BATCH_AND_SIZE:
            height, width = rows * model.network.largest_stride_px, columns * model.network.largest_stride_px
            coarse = torch.rand((batch, 3, height // 16, width // 16), generator=generator)
            image = functional.interpolate(coarse, (height, width), mode="bicubic").clamp(0, 1)
            camera = probe_camera(batch, height, width)
            native = None if model.refiner is None else probe_native(image)
            for found in (
                compare_networks(model, deployed.model, image, camera),
                compare_chains(deployed, reloaded, image, camera, native),
            ):
                worst = Parity(*[max(a, b) for a, b in zip(worst, found)])
        found = compare_fits(deployed.model.ranging, probe_camera(2, 96, 128))
        worst = Parity(*[max(a, b) for a, b in zip(worst, found)])
    if not (worst.px <= TOLERANCE_PX and worst.m_at_10_m <= TOLERANCE_M and worst.rest <= TOLERANCE_REST):
        raise ValueError(
            f"the exported model differs from its checkpoint by {worst.px:.3g} px, {1000 * worst.m_at_10_m:.3g} mm at "
            f"10 m and {worst.rest:.3g} elsewhere, expected at most {TOLERANCE_PX} px, {1000 * TOLERANCE_M:g} mm and "
            f"{TOLERANCE_REST:g}"
        )
    return worst


def compare_networks(model: USVNet, folded: USVNet, image: Tensor, camera: Camera) -> Parity:
    """Difference of all anchors' boxes, keypoints, scores and ranges, and of the heatmaps' centres of mass."""
    answers = []
    for one in (model, folded):
        output = one.network(image)
        height, width = output.heatmap_logits.shape[2:]
        whole_map = max(height, width)  # a window this wide holds every cell wherever it is put: nothing is chosen
        centre = torch.zeros(len(image), 1, output.heatmap_logits.shape[1], 2)
        points, _ = decode(output.heatmap_logits, centre, HEATMAP_STRIDE, whole_map, SIGMA_CELLS)
        covariance = torch.eye(2).expand(*output.keypoints_px.shape, 2)
        ranges = one.ranging(output.keypoints_px, covariance, output.boxes_px, camera)
        answers.append((output, points, (ranges.box_bottom, ranges.waterline)))  # a fit chooses where it starts
    (output_a, points_a, ranges_a), (output_b, points_b, ranges_b) = answers
    return Parity(
        px=max(
            difference(output_a.boxes_px, output_b.boxes_px),
            difference(output_a.keypoints_px, output_b.keypoints_px),
            difference(points_a, points_b),
        ),
        m_at_10_m=max(range_difference(a.slant_m, b.slant_m) for a, b in zip(ranges_a, ranges_b)),
        rest=difference(output_a.class_logits.sigmoid(), output_b.class_logits.sigmoid()),
    )


def compare_chains(
    deployed: DeployedUSVNet, reloaded: Answer, image: Tensor, camera: Camera, native: Native | None = None
) -> Parity:
    """Difference of everything that the whole chain answers, in memory and from the file.

    What a fit says is compared where it fits, by the median boat, since the fit of a single one may start elsewhere.
    """
    inputs = (*plain_inputs(image, camera, generic_hull(len(image))), *(native or ()))
    expected, got = shared_boats(deployed(*inputs), reloaded(*inputs))
    pixels = ("boxes_px", "keypoints_px")
    names = [name for name in expected if not name.startswith(OF_FITS)]
    ranges = [name for name in names if name.endswith(("_slant_m", "_horizontal_m", "_position_m"))]
    sigmas = [name for name in names if name.endswith("_slant_std_m")]
    fitting = expected["misfit"] < FITTING
    fits = [difference(expected[n][fitting], got[n][fitting], median=True) for n in ("heading_rad", "misfit")]
    fitted = [
        range_difference(expected[n][fitting], got[n][fitting], median=True) for n in ("hull_slant_m", "fused_slant_m")
    ]
    plain = {*names} - {*pixels, *ranges, *sigmas}
    return Parity(
        px=max(difference(expected[name], got[name]) for name in pixels),
        m_at_10_m=max(
            *(range_difference(expected[name], got[name], slant_m=slant_of(name, expected)) for name in ranges), *fitted
        ),
        rest=max(
            *(difference(expected[name], got[name], True) for name in plain),
            *(difference(at_10_m(name, expected), at_10_m(name, got), True) for name in sigmas),
            *fits,
        ),
    )


def slant_of(name: str, boats: dict[str, Tensor]) -> Tensor:
    """The slant range (M,) of the estimator that one of its answers is named after."""
    estimator = next(estimator for estimator in ESTIMATORS if name.startswith(f"{estimator}_"))
    return boats[f"{estimator}_slant_m"]


def at_10_m(name: str, boats: dict[str, Tensor]) -> Tensor:
    """A sigma (M,) as it would be at 10 m: as a range near the horizon is, its sigma is any pixel's rounding away."""
    slant_m = slant_of(name, boats)
    return torch.where(slant_m.isfinite(), boats[name] * share_at_10_m(slant_m), boats[name])


def shared_boats(expected: dict[str, Tensor], got: dict[str, Tensor]) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """The boats (M, ...) that are in both answers (B, N, ...), in one order; which they are is told by their boxes.

    Raises:
        ValueError: too few are.
    """
    gap_px = torch.cdist(expected["boxes_px"].double(), got["boxes_px"].double(), p=1.0)
    nearest_px, other = gap_px.min(2)
    shared = nearest_px < SAME_BOAT_PX
    if float(shared.double().mean()) < LEAST_SHARED:
        raise ValueError(
            f"the exported model differs from its checkpoint: it finds {int(shared.sum())} of the same "
            f"{shared.numel()} candidates, expected at least {100 * LEAST_SHARED:.0f} %"
        )
    picture = torch.arange(len(other))[:, None].expand_as(other)
    theirs = {name: value[picture[shared], other[shared]] for name, value in got.items()}
    return {name: value[shared] for name, value in expected.items()}, theirs


def compare_fits(ranging: RangingLayer, camera: Camera) -> Parity:
    """Difference of the ranges and headings of some boats, fitted by the layer as it is and by the layer scripted."""
    right_m, ahead_m, heading = torch.tensor(PROBE_BOATS_M).T[..., None]
    x, y, z = generic_hull().points_m[0].T
    sine, cosine = heading.sin(), heading.cos()
    below_m = camera.height_m[:, None, None] - z
    level_m = torch.broadcast_tensors(right_m + x * sine - y * cosine, below_m, ahead_m + x * cosine + y * sine)
    rotation = level_rotation(camera.pitch_rad, camera.roll_rad).unsqueeze(1)
    points_m = torch.stack(level_m, -1) @ rotation
    keypoints_px = project(points_m.flatten(1, 2), camera).unflatten(1, points_m.shape[1:3])
    boxes_px = torch.cat([keypoints_px.amin(2), keypoints_px.amax(2)], -1)
    covariance_px2 = torch.eye(2).expand(*keypoints_px.shape, 2)
    scripted = torch.jit.script(ranging)
    expected, got = (layer(keypoints_px, covariance_px2, boxes_px, camera) for layer in (ranging, scripted))
    pairs = ((expected.hull, got.hull), (expected.fused, got.fused))
    return Parity(
        px=0.0,
        m_at_10_m=max(range_difference(a.slant_m, b.slant_m) for a, b in pairs),
        rest=max(
            difference(expected.heading_rad, got.heading_rad),
            difference(expected.misfit, got.misfit),
            *[difference(a.slant_std_m, b.slant_std_m, relative=True) for a, b in pairs],
        ),
    )


def difference(a: Tensor, b: Tensor, relative: bool = False, median: bool = False) -> float:
    """Greatest (or median) absolute difference of the elements, divided by their size above 1 where ``relative``."""
    a, b = a.double(), b.double()
    gap = torch.where(a == b, 0.0, (a - b).abs())  # two infinities are equal
    return _one((gap / a.abs().clamp(min=1.0) if relative else gap).nan_to_num(nan=torch.inf), median)


def range_difference(a_m: Tensor, b_m: Tensor, median: bool = False, slant_m: Tensor | None = None) -> float:
    """Greatest (or median) difference of ranges (M,) or positions (M, 3), scaled to 10 m.

    A ray on the horizon may have a range in one only, which counts where the median is asked for.

    Args:
        a_m: what was expected.
        b_m: what was got.
        median: instead of the greatest.
        slant_m: (M,) how far the boats are; None where ``a_m`` says so itself.
    """
    a_m, b_m = a_m.double(), b_m.double()
    slant_m = a_m if slant_m is None else slant_m.double().view(-1, *[1] * (a_m.dim() - 1)).expand_as(a_m)
    both = a_m.isfinite() & (b_m.isfinite() | median)
    return _one((a_m[both] - b_m[both]).abs() * share_at_10_m(slant_m[both]), median)


def share_at_10_m(slant_m: Tensor) -> Tensor:
    """What is left at 10 m of an error at ``slant_m``, which grows with the square of the range."""
    return (REFERENCE_RANGE_M / slant_m.clamp(min=REFERENCE_RANGE_M)).square()


def _one(differences: Tensor, median: bool) -> float:
    """Of any number of differences, 0 where there is none."""
    if not differences.numel():
        return 0.0
    return float(differences.median() if median else differences.max())
