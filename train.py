"""Train usvnet: python train.py --config configs/experiment/quickstart.yaml."""

from pathlib import Path

from usvnet.files import run_program


def main() -> None:
    """Train; then, where the configuration says so, score the best checkpoint on the test split and export it."""
    # imported after run_program has begun, so that Ctrl-C while importing is handled too
    from usvnet.training_cli import TrainingCLI

    cli = TrainingCLI()
    checkpoint = cli.fit()
    if not cli.trainer.is_global_zero:
        return
    print(f"trained: {checkpoint}")
    if cli.config.evaluate_after:
        from usvnet.evaluation.evaluator import evaluate_checkpoint

        data = cli.datamodule
        evaluate_checkpoint(checkpoint, data.dataset("test"), "test", batch_size=data.batch_size, overwrite=True)
    if cli.config.export_after:
        from usvnet.commands.export import export

        export(checkpoint=checkpoint, output=Path(cli.config.run_dir) / "usvnet.ts")


if __name__ == "__main__":
    run_program(main)
