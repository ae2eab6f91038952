"""Evaluate usvnet: python evaluate.py --config configs/experiment/x.yaml --checkpoint runs/x/checkpoints/best.ckpt."""

import sys
from argparse import SUPPRESS
from typing import Any

from usvnet.files import run_program

OF_TRAINING = (
    *("seed_everything", "trainer", "model", "run_dir"),
    *("ckpt_path", "resume", "evaluate_after", "export_after"),
)
"""Keys of a training configuration that evaluation does not read: the checkpoint knows its own network."""


def main() -> None:
    """Score a checkpoint on a split of the configuration's dataset."""
    # imported after run_program has begun, so that Ctrl-C while importing is handled too
    from usvnet.checkpoints import STAMP, read_checkpoint
    from usvnet.data.datamodule import BoatDataModule
    from usvnet.deploy.predictor import default_checkpoint
    from usvnet.evaluation.calibrator import calibrate_checkpoint
    from usvnet.evaluation.evaluator import evaluate_checkpoint, unlike_training
    from usvnet.training_cli import OneLineParser, quiet

    quiet()
    parser = OneLineParser(description="Score a trained usvnet: predictions, tables, metrics.json, overlay pictures.")
    parser.add_argument("--config", action="config", help="the configuration that trained it")
    parser.add_argument(
        "--checkpoint", type=str | None, default=None, help="written by train.py [checkpoints/usvnet-n.pt]"
    )
    parser.add_argument("--split", type=str, default="test", help="train, val or test")
    parser.add_argument("--output", type=str | None, default=None, help="folder of the results [beside the checkpoint]")
    parser.add_argument(
        "--report", type=bool | str, nargs="?", const=True, default=False, help="also one HTML page [report.html]"
    )
    parser.add_argument("--range_confidence", type=float, default=0.25, help="score a boat needs before it is ranged")
    parser.add_argument("--overwrite", action="store_true", help="predict anew, whatever the folder holds")
    parser.add_argument(
        "--calibrate_intervals", type=str | None, default=None, help="first calibrate the checkpoint on this split"
    )
    parser.add_class_arguments(BoatDataModule, "data")
    for key in OF_TRAINING:
        parser.add_argument(f"--{key}", type=Any, help=SUPPRESS)
    settings = parser.parse_args()
    settings.data.augmentation = None  # also where the training split is scored
    data: BoatDataModule = parser.instantiate(settings).data
    if settings.calibrate_intervals == settings.split:
        raise ValueError(f"calibrate_intervals: got {settings.split}, the split that is scored, expected another one")
    configuration = parser.dump(settings, skip_unset=False)
    if settings.checkpoint is None:
        settings.checkpoint = default_checkpoint()
        settings.output = settings.output or f"runs/{settings.checkpoint.stem}/evaluation/{settings.split}"
        if settings.calibrate_intervals is not None:
            raise ValueError(f"calibrate_intervals changes a checkpoint: name a copy of {settings.checkpoint} with it")
    stamp = read_checkpoint(settings.checkpoint)[STAMP]  # a damaged one is told before horizons are looked for
    for sentence in unlike_training(stamp, data.eval_image_size, data.native_size):
        print(f"note: {settings.checkpoint} {sentence}", file=sys.stderr)
    if settings.calibrate_intervals is not None:
        if stamp.get("refine") and data.native_size is None:
            raise ValueError("calibrate_intervals: expected data.native_size, too: a second look is calibrated")
        calibrated_on = data.dataset(settings.calibrate_intervals)
        calibrate_checkpoint(
            settings.checkpoint, calibrated_on, settings.calibrate_intervals, data.batch_size, settings.range_confidence
        )
    evaluate_checkpoint(
        settings.checkpoint,
        data.dataset(settings.split),
        settings.split,
        settings.output,
        batch_size=data.batch_size,
        range_confidence=settings.range_confidence,
        overwrite=settings.overwrite,
        report=settings.report,
        configuration=configuration,
    )


if __name__ == "__main__":
    run_program(main)
