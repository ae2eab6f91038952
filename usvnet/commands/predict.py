"""``usvnet predict``: boats and their ranges in pictures, videos, webcams and streams."""

import signal
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from usvnet import __version__
from usvnet.allocator import keep_freed_memory
from usvnet.checkpoints import sha256
from usvnet.data.attitudes import AttitudeConfig
from usvnet.deploy.annotated import annotated_pictures, annotated_video
from usvnet.deploy.attitudes import FrameAttitudes
from usvnet.deploy.decoder_talk import decoder_talk
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.outputs import Outputs, Writer, boat_table, json_lines
from usvnet.deploy.predictor import Predictor, best_estimator, check_estimator, default_checkpoint
from usvnet.deploy.run import Tally, predict_source, stopped_by_signals
from usvnet.deploy.sources import Photographs, Source
from usvnet.deploy.streams import LiveStream, is_stream, open_source
from usvnet.deploy.track_files import mot_text, track_table
from usvnet.deploy.tracking import BoatFollower
from usvnet.evaluation.records import RANGE_CONFIDENCE
from usvnet.files import Terminated
from usvnet.tracking.tracker import TrackingConfig
from usvnet.visualize.scene import SceneDrawer
from usvnet.wording import counted

LINES, TABLE, VIDEO, PICTURES = "predictions.jsonl", "predictions.csv", "video.mp4", "pictures"
TRACK_TABLE, MOT_TEXT = "tracks.csv", "tracks.txt"
OUTPUTS = (LINES, TABLE, VIDEO, PICTURES, TRACK_TABLE, MOT_TEXT)
RULES = TrackingConfig()


def predict(
    source: str,
    *,
    camera: Path,
    checkpoint: Path | None = None,
    model: Path | None = None,
    hull: Path | None = None,
    attitude: Literal["file", "horizon", "combined"] = "file",
    imu: Path | None = None,
    imu_offset_s: float = 0.0,
    output: Path = Path("predictions"),
    estimator: str | None = None,
    image_size: int | None = None,
    confidence: float | None = None,
    batch_size: int = 1,
    every: int = 1,
    fps: float | None = None,
    max_frames: int | None = None,
    save: Literal["auto", "pictures", "video", "none"] = "auto",
    show_topdown: bool = True,
    track: bool = False,
    tracking: TrackingConfig = RULES,
    device: str | None = None,
) -> None:
    """Find the boats in pictures or a video, and say how far away they are and how sure that is.

    Writes predictions.jsonl (everything, frame by frame), predictions.csv (a row for each boat), and the pictures or
    the video with boats, ranges, horizon and a chart drawn on. Files of the same names are replaced. Ctrl-C ends a run
    early; what was predicted until then is kept.

    Args:
        source: Picture, folder, glob (quote it), video, number of a webcam, or rtsp:// or http:// address.
        camera: Camera file of usvnet calibrate, with the mount; scaled where pictures have another size but its shape.
        checkpoint: Weights written by train.py; checkpoints/usvnet-n-refine.pt where none is named.
        model: File of usvnet export (.ts, .pt, .pt2, .onnx or .xml) to compute with instead of a checkpoint.
        hull: Hull file of the boats to expect, for the estimators hull and fused; a generic one where none is named.
        attitude: Pitch and roll from files (the imu's, else the mount's), from the horizon seen in the picture (the
            files' where none is seen), or from both combined.
        imu: CSV with time_s, pitch_deg and roll_deg (and their _std_deg) of the camera; its time is the video's own,
            from its start.
        imu_offset_s: Time of the imu less that of the frame at the same moment.
        output: Folder of the results.
        estimator: The range to draw and to count; the best there is where none is named.
        image_size: Longer side of what the network sees, pixels; the size it was trained on where none is named.
        confidence: Lowest score of a boat; 0.25, or what the model was exported with, where none is named.
        batch_size: Pictures, or frames of a video, computed at once; a stream's frames go one by one.
        every: Take one frame in so many.
        fps: How many pictures of a folder were taken a second, if they are the frames of a video.
        max_frames: Stop after so many.
        save: What to draw on; auto is a video of a video or stream, and pictures of pictures.
        show_topdown: Draw the chart that shows the boats from above.
        track: Follow the boats of a video, a stream or pictures with an fps from frame to frame: numbers, smoothed
            ranges with intervals, closing speed and closest point of approach, also in tracks.csv and, as MOTChallenge
            text, in tracks.txt.
            All is relative to the camera, which should not turn.
        tracking: When a boat counts as one, how long it is believed in, and how it may move.
        device: Where to compute, e.g. cpu or cuda:1; the first GPU where there is one.

    Raises:
        FileNotFoundError: no such source, camera file or checkpoint.
        ValueError: one that is not what it should be, or an option out of range.
        ConnectionError: a stream that cannot be opened, or that broke off and did not come back.
    """
    keep_freed_memory()  # pictures come and go all day: the process is soon as large as it will be, and stays so
    estimator = estimator or best_estimator()
    check_estimator(estimator)
    for name, number in (("batch_size", batch_size), ("max_frames", max_frames)):
        if number is not None and number < 1:
            raise ValueError(f"{name}: got {number}, expected at least 1")
    if checkpoint is not None and model is not None:
        raise ValueError("checkpoint and model: got both, expected one of them")
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output}: expected a folder for the results, but it is a file")
    weights = model or checkpoint or default_checkpoint(refine=True)
    console = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)
    before = [output / name for name in OUTPUTS if (output / name).exists()]
    with decoder_talk() as talk:
        # files are looked at before the network gets ready, which takes seconds; a stream's frames would grow old
        files = None if is_stream(source) else open_source(source, console.print, every, fps)
        if imu is not None and files is None:
            raise ValueError(
                f"imu: {source}: what is taken now is in no log yet, expected a video, or pictures with fps"
            )
        for name, wanted in (("imu", imu is not None), ("track", track)):
            if wanted and isinstance(files, Photographs) and fps is None:
                raise ValueError(f"{name}: {source}: pictures have no time, expected their fps, a video or a stream")
        if track and files is not None:
            _check_pace(files, tracking)
        exported = ExportedModel(weights, device) if model else None
        if confidence is None:
            confidence = exported.score_threshold if exported else RANGE_CONFIDENCE
        predictor = Predictor(exported or weights, camera, hull, image_size, confidence, device)
        attitudes = FrameAttitudes(AttitudeConfig(attitude, imu_offset_s), imu)
        follower = BoatFollower(estimator, tracking) if track else None
        predictor.warm_up()
        frames = files or open_source(source, console.print, every, fps)
        meta = {
            "program": f"usvnet predict {__version__}",
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "source": frames.name,
            "every": every,
            "fps": fps,
            "camera": str(camera),
            "camera_sha256": sha256(camera),
            "checkpoint": str(weights),
            "checkpoint_sha256": sha256(weights),
            "hull": None if hull is None else str(hull),
            "attitude": attitude,
            "imu": None if imu is None else str(imu),
            "imu_offset_s": imu_offset_s,
            "image_size": predictor.image_size,
            "confidence": confidence,
            "intervals": {name: list(found) for name, found in predictor.factors.items()},
            "estimator": estimator,
            "tracking": asdict(tracking) if track else None,
        }
        writers = _writers(frames, output, meta, estimator, save, SceneDrawer(estimator, show_topdown), track)
        with Outputs(writers) as outputs, stopped_by_signals(frames) as signals, _progress(console) as progress:
            task = progress.add_task("predicting", total=_fewer(frames.total, max_frames), pace="")

            def watch(tally: Tally) -> None:
                progress.update(task, completed=tally.frames, pace=f"{tally.frames_per_s:.1f} frames/s")

            options = (batch_size, max_frames, watch, attitudes.turn, follower.follow if follower else None)
            tally = predict_source(frames, predictor, outputs, estimator, console.print, *options)
    _tell(frames, predictor, tally, estimator)
    if talk.complaints:
        print(talk.told())
    if attitudes.outcomes:
        print("attitude: " + ", ".join(f"{what} {count}" for what, count in attitudes.outcomes.most_common()))
    if follower:
        print(f"boats followed: {follower.tracker.confirmed}")
    if outputs.written:
        print(f"wrote {', '.join(str(path) for path in outputs.written)}")
        old = [path for path in before if path not in outputs.written or path.name == PICTURES]
        if old:
            print(f"note: still there from an earlier run: {', '.join(str(path) for path in old)}")
    if signals:
        raise Terminated if signal.SIGTERM in signals else KeyboardInterrupt
    if isinstance(frames, LiveStream) and frames.given_up:
        raise ConnectionError(f"{frames.name}: broke off and did not come back")
    if not tally.frames:
        raise ValueError(f"{source}: none of its pictures can be read")


def _check_pace(files: Source, tracking: TrackingConfig) -> None:
    """Refuse frames so far apart that every boat would be given up before the next of them, and none confirmed."""
    if files.frames_per_s is not None and 1 / files.frames_per_s > tracking.lost_s:
        raise ValueError(
            f"track: {files.name}: its frames are {1 / files.frames_per_s:g} s apart, expected at most the "
            f"{tracking.lost_s:g} s of --tracking.lost-s, after which a boat that is not seen is given up"
        )


def _writers(
    source: Source, folder: Path, meta: dict[str, Any], estimator: str, save: str, drawer: SceneDrawer, track: bool
) -> dict[Path, Writer]:
    writers: dict[Path, Writer] = {
        folder / LINES: lambda: json_lines(folder / LINES, meta, estimator),
        folder / TABLE: lambda: boat_table(folder / TABLE, estimator, track),
    }
    if track:
        writers[folder / TRACK_TABLE] = lambda: track_table(folder / TRACK_TABLE)
        writers[folder / MOT_TEXT] = lambda: mot_text(folder / MOT_TEXT)
    if save == "auto":
        save = "pictures" if isinstance(source, Photographs) else "video"
    if save == "pictures":
        writers[folder / PICTURES] = lambda: annotated_pictures(folder / PICTURES, drawer, source)
    if save == "video":
        writers[folder / VIDEO] = lambda: annotated_video(folder / VIDEO, drawer, source)
    return writers


def _fewer(total: int | None, most: int | None) -> int | None:
    counts = [count for count in (total, most) if count is not None]
    return min(counts) if counts else None


def _progress(console: Console) -> Progress:
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
    return Progress(*columns, TimeRemainingColumn(), console=console, transient=True)


def _tell(source: Source, predictor: Predictor, tally: Tally, estimator: str) -> None:
    """Print what came out, what it took and what was lost."""
    if tally.frames:
        stages = ", ".join(f"{name} {1000 * spent / tally.frames:.1f}" for name, spent in tally.seconds.items())
        seconds, frames = tally.frames / tally.frames_per_s, counted(tally.frames, "frame")
        print(f"{frames} in {seconds:.1f} s: {tally.frames_per_s:.1f} frames per second ({stages} ms)")
        reach = f", from {tally.nearest_m:.1f} to {tally.farthest_m:.1f} m" if tally.ranged else ""
        print(f"{counted(tally.boats, 'boat')}, {tally.ranged} of them ranged by {estimator}{reach}")
    native = tuple(int(side) for side in predictor.camera.size_px[0])
    scaled = [f"{width} x {height}" for width, height in predictor.sizes_px if (width, height) != native]
    if scaled:
        print(f"{predictor.camera_name}: scaled from {native[0]} x {native[1]} to pictures of {', '.join(scaled)}")
    losses = source.losses
    for count, what, many in (
        (losses.unreadable, "frame could not be read", "frames could not be read"),
        (tally.misfits, "picture does not have the camera's shape", "pictures do not have the camera's shape"),
        (losses.overtaken, "frame of the stream was overtaken by a newer one",
         "frames of the stream were overtaken by newer ones"),
        (losses.interruptions, "time the stream broke off", "times the stream broke off"),
    ):  # fmt: skip
        if count:
            print(counted(count, what, many))
