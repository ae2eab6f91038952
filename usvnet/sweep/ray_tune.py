"""Runs on several graphics cards or machines through Ray Tune (extra ``ray``).

All machines must see the repository, the dataset and the sweep's folder at the same paths, as on a network file system:
a trial does nothing but start the run's process there.
"""

import os
from pathlib import Path
from typing import Any

from usvnet.sweep import local
from usvnet.sweep.board import Board
from usvnet.sweep.local import failure, run_alone
from usvnet.sweep.plan import Run


def run_with_ray(runs: list[Run], parallel: int | None, storage: Path, board: Board) -> dict[str, str]:
    """Train and score runs as trials of Ray Tune, on the cluster that ``ray start`` made or on this machine.

    Args:
        runs: what is to be done.
        parallel: trials at a time at most; None for as many as there are cards (or, without any, cores) for.
        storage: Ray's own folder.
        board: is told what begins and ends.

    Returns:
        Name -> why it failed, in one line.

    Raises:
        ValueError: Ray is not installed.
    """
    os.environ.setdefault("RAY_AUTH_MODE", "disabled")
    try:
        import ray
        from ray import tune
    except ImportError:
        raise ValueError('--ray needs Ray: pip install -c constraints.txt -e ".[ray]"') from None

    ray.init(ignore_reinit_error=True, log_to_driver=False, logging_level="ERROR")
    here, command = Path.cwd(), local.COMMAND
    variables = {name: value for name, value in os.environ.items() if name.startswith("OMP_")}

    def trial(config: dict[str, Any]) -> None:
        os.chdir(here)
        os.environ.update(variables)
        folder = Path(config["run"]["folder"])
        with run_alone(folder, command) as process:
            tune.report({"reason": failure(folder, process)})

    cards = ray.cluster_resources().get("GPU", 0) > 0
    trials = [{"name": run.name, "folder": str(run.folder.resolve()), "cards": _cards(run)} for run in runs]
    tuner = tune.Tuner(
        tune.with_resources(trial, lambda config: {"cpu": 1, "gpu": config["run"]["cards"] if cards else 0}),
        param_space={"run": tune.grid_search(trials)},
        tune_config=tune.TuneConfig(max_concurrent_trials=parallel),
        run_config=tune.RunConfig(storage_path=str(storage.resolve()), verbose=0),
    )
    for run in runs:
        board.begin(run)
    reasons = {}
    for result in tuner.fit():
        reason = " ".join(str(result.error).split()) if result.error else result.metrics["reason"]
        reasons[result.config["run"]["name"]] = reason
    for run in runs:
        board.end(run, reasons.get(run.name, "its trial has disappeared"))
    return {name: reason for name, reason in reasons.items() if reason}


def _cards(run: Run) -> int:
    devices = run.configuration["trainer.devices"]
    return devices if isinstance(devices, int) else 1
