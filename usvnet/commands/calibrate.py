"""``usvnet calibrate``: photographs or a video of a chessboard in, ``camera.yaml`` and a coverage picture out."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from rich.console import Console
from rich.progress import track

from usvnet.commands.calibration_report import draw_coverage, result_table, view_table
from usvnet.commands.pictures import Pictures, open_pictures
from usvnet.files import atomic_write
from usvnet.geometry.calibration import (
    MIN_VIEWS,
    CalibrationResult,
    View,
    board_points,
    calibrate_robustly,
)
from usvnet.geometry.calibration_quality import LEAST_TILT_DEG, WEAK_TILT_DEG, cautions, tilt_spread_deg
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import save_camera
from usvnet.geometry.chessboard import (
    DETECTORS,
    Board,
    Findings,
    find_corners,
    find_views,
    parse_board,
)
from usvnet.wording import counted


def calibrate(
    source: str,
    *,
    board: str,
    square_mm: float,
    height_m: float,
    pitch_deg: float = 0.0,
    roll_deg: float = 0.0,
    height_std_m: float = 0.02,
    pitch_std_deg: float = 0.3,
    roll_std_deg: float = 0.3,
    output: str = "camera.yaml",
    style: Literal["ros", "opencv"] = "ros",
    detector: Literal["auto", "classic", "sb"] = "auto",
    outlier_error_px: float = 0.5,
    radial_terms: Literal[2, 3] = 3,
    fixed_aspect: bool = False,
    every_n_frames: int = 10,
    max_views: int = 60,
) -> None:
    """Find a camera's focal length and distortion, with their sigmas, from pictures of a chessboard (Zhang 2000).

    Print or glue the board on something flat. Take 10 to 20 pictures with the camera at its final focus: the board
    near each corner of the picture and in its middle, tilted by 30 to 45 degrees in different directions.

    Args:
        source: Glob of photographs (quote it), folder of photographs, or a video file.
        board: Inner corners of the board, where four squares meet, as COLUMNSxROWS, e.g. 9x6.
        square_mm: Side of one square in millimetres.
        height_m: Height of the camera's optical centre above mean water in metres, as it will be mounted.
        pitch_deg: How far the optical axis points below the horizontal.
        roll_deg: How far the camera is turned clockwise, seen from behind.
        height_std_m: How well the height is known, one sigma.
        pitch_std_deg: How well the pitch is known, one sigma; 0.3 is a good spirit level.
        roll_std_deg: How well the roll is known, one sigma.
        output: Camera file to write; the coverage picture goes beside it as <name>_coverage.png.
        style: Write a ROS camera_info or an OpenCV FileStorage YAML.
        detector: OpenCV's corner detector; auto runs both and keeps the one that leaves the smaller focal sigma,
            which counts the number of boards found as well as how well they fit.
        outlier_error_px: Views with an error below this are never left out.
        radial_terms: 3 fits k1, k2 and k3; 2 holds k3 at zero.
        fixed_aspect: Square pixels, fx = fy.
        every_n_frames: Of a video, look at one frame in so many.
        max_views: When more boards than this are found, so many evenly spaced ones are used.

    Raises:
        ValueError: an option out of range, a picture that cannot be read or differs in size, too few boards found.
        FileNotFoundError: nothing at ``source``.
    """
    corners = parse_board(board)
    if not (math.isfinite(square_mm) and square_mm > 0):
        raise ValueError(f"square_mm must be above 0 millimetres, got {square_mm:g}")
    if max_views < MIN_VIEWS:
        raise ValueError(f"max_views must be at least {MIN_VIEWS}, got {max_views}")
    target = Path(output)
    if target.suffix not in (".yaml", ".yml"):
        raise ValueError(f"output must end in .yaml or .yml, got {output!r}")
    mount_camera = partial(
        make_camera,
        height_m=height_m,
        pitch_rad=math.radians(pitch_deg),
        roll_rad=math.radians(roll_deg),
        height_std_m=height_std_m,
        pitch_std_rad=math.radians(pitch_std_deg),
        roll_std_rad=math.radians(roll_std_deg),
    )
    mount_camera(torch.eye(3), (1, 1))  # a mount that cannot be is refused before the pictures are searched
    pictures = open_pictures(source, every_n_frames)

    console = Console(soft_wrap=True)
    progress = track(pictures, f"looking for the {board} board", len(pictures) or None, console=console)
    detectors = DETECTORS if detector == "auto" else (detector,)
    findings = find_views(progress, corners, detectors, skip_repeats=pictures.is_video)
    _tell_findings(console, findings, board)
    _check_enough(findings, pictures, corners, board)

    points = board_points(*corners, square_mm)
    results = {
        name: calibrate_robustly(
            points, _thin(views, max_views), findings.size_px, fixed_aspect, radial_terms, outlier_error_px
        )
        for name, views in findings.views.items()
        if len(views) >= MIN_VIEWS
    }
    chosen = choose_detector(results)
    result = results[chosen]
    if (spread := tilt_spread_deg(result)) < LEAST_TILT_DEG:
        raise ValueError(
            f"the boards are parallel to one another within {spread:.1f} degrees, which tells no focal length: "
            f"expected at least {LEAST_TILT_DEG:g}, better 30 to 45, tilted in different directions"
        )
    if (found := len(findings.views[chosen])) > max_views:
        console.print(f"used {max_views} of {found} views, evenly spaced (max_views)")
    _tell_result(console, result)
    _tell_detectors(console, results, chosen)

    K, distortion = torch.from_numpy(result.K), torch.from_numpy(result.distortion)
    camera = mount_camera(K, result.size_px, distortion, focal_std_px=result.focal_std_px)
    picture = target.with_name(f"{target.stem}_coverage.png")
    save_camera(camera, target, style=style, name=target.stem)
    with atomic_write(picture) as temporary:
        draw_coverage(result, temporary)
    console.print(f"wrote {target} and {picture}")


def choose_detector(results: Mapping[str, CalibrationResult]) -> str:
    """The detector whose views tell the focal length best: where boards are parallel, its sigma means nothing."""
    return min(
        results,
        key=lambda name: (
            tilt_spread_deg(results[name]) < WEAK_TILT_DEG,
            results[name].focal_std_px / results[name].focal_px,
        ),
    )


def _thin(views: list[View], max_views: int) -> list[View]:
    """At most ``max_views``, evenly spaced."""
    if len(views) <= max_views:
        return views
    return [views[i * len(views) // max_views] for i in range(max_views)]


def _tell_findings(console: Console, findings: Findings, board: str) -> None:
    counts = ", ".join(f"{name} {len(views)}" for name, views in findings.views.items())
    width, height = findings.size_px
    repeated = f", {findings.num_repeated} repeated a view and were skipped" if findings.num_repeated else ""
    pictures = counted(findings.num_pictures, "picture")
    console.print(f"{pictures} of {width}x{height} px; whole boards found: {counts}{repeated}")
    if findings.missed:
        shown = ", ".join(findings.missed[:8]) + (" ..." if len(findings.missed) > 8 else "")
        console.print(f"no whole {board} board in {len(findings.missed)}: {shown}")


def _check_enough(findings: Findings, pictures: Pictures, corners: Board, board: str) -> None:
    """Raise ValueError when no detector found enough views, with the usual reason if it can be seen."""
    most = max(len(views) for views in findings.views.values())
    if most >= MIN_VIEWS:
        return
    if most:
        raise ValueError(
            f"a whole {board} board was found in {most} of {counted(findings.num_pictures, 'picture')}, "
            f"a calibration needs at least {MIN_VIEWS} different ones"
        )
    fewer = (corners[0] - 1, corners[1] - 1)
    hint = "; count the inner corners, where four squares meet, and show the whole board with a white margin"
    if min(fewer) >= 3:
        for (name, grey), _ in zip(pictures, range(3)):
            if find_corners(grey, fewer, "classic") is not None:
                hint = f", but {name} shows a {fewer[0]}x{fewer[1]} one: count the inner corners, not the squares"
                break
    raise ValueError(f"no {board} board found in any of {counted(findings.num_pictures, 'picture')}{hint}")


def _tell_result(console: Console, result: CalibrationResult) -> None:
    console.print(view_table(result))
    for bad in result.rejected:
        console.print(f"[red]left out {bad.view.name}[/]: its {bad.error_px:.2f} px stand far above the other views")
    console.print(result_table(result))
    for sentence in cautions(result):
        console.print(f"[yellow]caution[/]: {sentence}")


def _tell_detectors(console: Console, results: dict[str, CalibrationResult], chosen: str) -> None:
    """Say which detector was kept, and what the other would have said."""
    if len(results) == 1:
        return
    for name, result in results.items():
        word = "kept: smallest focal sigma" if name == chosen else "not kept"
        console.print(
            f"detector {name}: f {result.focal_px:.2f} +- {result.focal_std_px:.2f} px, RMS {result.rms_px:.3f} px, "
            f"{len(result.views)} views ({word})"
        )
    low, high = sorted(results.values(), key=lambda result: result.focal_px)
    apart = high.focal_px - low.focal_px
    if apart > 3 * math.hypot(low.focal_std_px, high.focal_std_px):
        console.print(
            f"[yellow]caution[/]: the two detectors' focal lengths differ by {apart:.1f} px, more than their sigmas "
            "explain: the focal sigma in the file is too small"
        )
