"""Train usvnet: python train.py --config configs/experiment/quickstart.yaml [--model.variant s ...]."""

from usvnet.files import run_program


def main() -> None:
    """Train, and where the configuration says so evaluate and export."""
    from usvnet.training_cli import TrainingCLI  # after run_program, so that Ctrl-C while importing is handled too

    cli = TrainingCLI()
    cli.fit()


if __name__ == "__main__":
    run_program(main)
