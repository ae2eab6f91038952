"""The command line of train.py: one configuration in YAML, any key of it overridable."""

import logging
import sys
import warnings
from pathlib import Path
from typing import Any, NoReturn

import yaml
from lightning.pytorch import Trainer
from lightning.pytorch.cli import LightningArgumentParser, LightningCLI
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.trainer.states import TrainerStatus

from usvnet.callbacks import CHECKPOINT_FOLDER, run_callbacks
from usvnet.checkpoints import check_variant, read_checkpoint
from usvnet.data.datamodule import BoatDataModule
from usvnet.network.variants import check_picture_size
from usvnet.training import USVModule
from usvnet.wording import did_you_mean, in_plain_words

TRAINER_DEFAULTS = {
    "max_epochs": 100,
    "gradient_clip_val": 10.0,
    "num_sanity_val_steps": 0,
    "log_every_n_steps": 10,
    "enable_model_summary": False,
}


class OneLineParser(LightningArgumentParser):
    """A parser that takes no key for another and leaves the one line on it to :func:`usvnet.files.run_program`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, allow_abbrev=False, **kwargs)

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        """Raise instead of printing the usage and leaving."""
        known = self.get_defaults(skip_validation=True).keys()
        raise ValueError(did_you_mean(in_plain_words(message), known)) from ex


class TrainingCLI(LightningCLI):
    """Everything that a run needs, built from the command line: ``model``, ``datamodule``, ``trainer``.

    Args:
        args: the command line, or None for the one of this process.

    Raises:
        ValueError: an unknown key or a value that does not fit.
    """

    def __init__(self, args: list[str] | None = None) -> None:
        quiet()
        super().__init__(
            USVModule,
            BoatDataModule,
            save_config_kwargs={"overwrite": True},
            trainer_defaults=TRAINER_DEFAULTS,
            seed_everything_default=0,
            parser_class=OneLineParser,
            parser_kwargs={"description": "Train usvnet. Continue a run with --resume true."},
            args=args,
            run=False,
            auto_configure_optimizers=False,
        )

    def add_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """Add what belongs to the run as a whole."""
        parser.add_argument("--run_dir", type=str, default="runs/default", help="folder of all results of the run")
        parser.add_argument("--ckpt_path", type=str | None, default=None, help="checkpoint to continue from")
        parser.add_argument("--resume", type=bool, default=False, help="continue from the run folder's last checkpoint")
        parser.add_argument("--evaluate_after", type=bool, default=False, help="score the test split when trained")
        parser.add_argument("--export_after", type=bool, default=False, help="write the TorchScript when trained")

    def before_instantiate_classes(self) -> None:
        """Put logs and checkpoints in the run folder."""
        self.trainer_defaults = {**TRAINER_DEFAULTS, "callbacks": run_callbacks(self.config.run_dir)}

    def instantiate_classes(self) -> None:
        """Build model, data and trainer, and make sure that the pictures fit the network.

        Raises:
            ValueError: they do not.
        """
        super().instantiate_classes()
        for key in ("image_size", "eval_image_size"):
            check_picture_size(self.model.model.network, f"data.{key}", getattr(self.datamodule, key))
        refine, native_size = self.model.model.refiner is not None, self.datamodule.native_size
        if refine and native_size is None:
            raise ValueError("model.refine is native, which needs data.native_size: the longer side of the pictures")
        if native_size is not None and not refine:
            raise ValueError(f"data.native_size is {native_size}, which needs model.refine to be native")

    def instantiate_trainer(self, **kwargs: Any) -> Trainer:
        """Build the trainer with its logger in the run folder."""
        logger = TensorBoardLogger(self.config.run_dir, name="", version="")
        return super().instantiate_trainer(logger=logger, **kwargs)

    @property
    def checkpoints(self) -> Path:
        """Folder of ``best.ckpt`` and ``last.ckpt``."""
        return Path(self.config.run_dir) / CHECKPOINT_FOLDER

    def start_checkpoint(self) -> Path | None:
        """The checkpoint to continue from, None for a fresh start.

        Raises:
            FileNotFoundError: it does not exist.
            ValueError: it is not one of ours, of another size, or holds weights alone.
        """
        path = self.checkpoints / "last.ckpt" if self.config.resume else self.config.ckpt_path
        if path is None:
            return None
        checkpoint = read_checkpoint(path)
        check_variant(path, checkpoint, self.model.model.variant)
        if "optimizer_states" not in checkpoint:
            raise ValueError(
                f"{path}: got weights alone, expected a run to continue: start with --model.initial_weights"
            )
        return Path(path)

    def fit(self) -> Path:
        """Train to the end.

        Returns:
            The best checkpoint, or the last one where nothing was validated.

        Raises:
            KeyboardInterrupt: the user stopped the run; a line on stderr says how to go on.
            ValueError: nothing to choose the best checkpoint by, a run without end, or faulty data.
        """
        start = self.start_checkpoint()
        self._expect_labels()
        best = self.checkpoints / "best.ckpt"
        of_another_run = best.stat().st_mtime_ns if start is None and best.is_file() else None
        if start is None and (self.checkpoints / "last.ckpt").is_file() and self.trainer.is_global_zero:
            note = "its checkpoints will be replaced (--resume true goes on with it instead)"
            print(f"note: {self.config.run_dir} holds a run already, {note}", file=sys.stderr)
        try:
            self.trainer.fit(self.model, self.datamodule, ckpt_path=start, weights_only=True)
        except SystemExit:  # Lightning's way out of Ctrl-C
            if self.trainer.state.status != TrainerStatus.INTERRUPTED:
                raise
            last = self.checkpoints / "last.ckpt"
            if last.is_file():
                print("to continue, add --resume true to the same command", file=sys.stderr)
            raise KeyboardInterrupt from None
        if best.is_file() and best.stat().st_mtime_ns == of_another_run:  # nothing was validated, nothing replaced it
            if self.trainer.is_global_zero:
                best.unlink()
            return self.checkpoints / "last.ckpt"
        return best if best.is_file() else self.checkpoints / "last.ckpt"

    def _expect_labels(self) -> None:
        """Insist on labels to validate by: without, the fitness is no number, and the first epoch stays the best."""
        if self.trainer.limit_val_batches == 0:
            return
        if not any((frame.visibility > 0).any() for frame in self.datamodule.frames("val")):
            raise ValueError(
                f"{self.datamodule.root}: no boat of val has a labelled keypoint to choose the best checkpoint by, "
                "expected labels where the reader looks for them (--trainer.limit_val_batches 0 trains without)"
            )


class TrainingConfiguration(TrainingCLI):
    """The configuration of a run, parsed and checked; nothing is built."""

    def instantiate_classes(self) -> None:
        """Leave the configuration as it is."""

    def resolve(self, args: list[str]) -> dict[str, Any]:
        """Give every key that a command line comes to, in nested plain values.

        Raises:
            ValueError: an unknown key or a value that does not fit.
        """
        content: dict[str, Any] = yaml.safe_load(self.parser.dump(self.parser.parse_args(args), skip_unset=False))
        return content


def quiet() -> None:
    """Silence what Lightning tells its developers and advertises to everybody."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    for what in (
        *("not have many workers", "Checkpoint directory", "dirpath has", "training batches", "LeafSpec"),
        "sync_dist=True",  # every process has scored the whole set already
        "args parameter is intended",
        "your dataloader is not resumable",  # its samplers are: tests/test_resume.py
        "in eval mode at the start of training",  # a frozen detector is
    ):
        warnings.filterwarnings("ignore", f".*{what}.*")
