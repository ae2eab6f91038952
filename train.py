"""Train usvnet: python train.py --config configs/experiment/quickstart.yaml."""

from pathlib import Path

from usvnet.files import run_program


def main() -> None:
    """Train and calibrate the intervals; then, where the configuration says so, score the test split and export."""
    # imported after run_program has begun, so that Ctrl-C while importing is handled too
    from usvnet.evaluation.calibrator import calibrate_checkpoint
    from usvnet.training_cli import TrainingCLI

    cli = TrainingCLI()
    if cli.config.evaluate_after:
        cli.datamodule.dataset("test")  # a fault in it is told now, not after hours
    checkpoint = cli.fit()
    if not cli.trainer.is_global_zero:
        return
    print(f"trained: {checkpoint}")
    data = cli.datamodule
    calibrate_checkpoint(checkpoint, data.dataset("val"), "val", data.batch_size)
    if cli.config.evaluate_after:
        from usvnet.evaluation.evaluator import evaluate_checkpoint

        evaluate_checkpoint(checkpoint, data.dataset("test"), "test", batch_size=data.batch_size, overwrite=True)
    if cli.config.export_after:
        from usvnet.commands.export import export

        export(checkpoint=checkpoint, output=Path(cli.config.run_dir) / "usvnet.ts")


if __name__ == "__main__":
    run_program(main)
