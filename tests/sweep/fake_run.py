"""Stands in for ``usvnet.sweep.one_run`` and takes milliseconds; its scores follow from the configuration.

``FAKE_FAILS`` names the run that fails, ``FAKE_VANISHES`` the one that ends without a word. Each start is a line in the
run's ``starts.txt``.
"""

import hashlib
import os
import sys
from pathlib import Path

from usvnet.sweep.progress import Progress, Result, write_progress, write_result

folder = Path(sys.argv[1])
with (folder / "starts.txt").open("a") as starts:
    starts.write("started\n")
write_progress(folder, Progress("training", 1, 0.5))
if os.environ.get("FAKE_VANISHES") == folder.name:
    sys.exit(9)
if os.environ.get("FAKE_FAILS") == folder.name:
    print("Traceback ...\nerror: the sea is too rough\nmore")
    sys.exit(2)
configuration = (folder / "configuration.yaml").read_bytes()
score = hashlib.sha256(configuration).digest()[0] / 256
pose = dict.fromkeys(("precision", "recall", "map50", "map50_95"), score)
waterline = {"rmse_m": 1 - score, "mae_m": 0.5 - score / 2, "missed": 1}
metrics = {"pose": pose, "pose_strict": pose, "ranges": {"overall": {"waterline": waterline}}}
result = Result(hashlib.sha256(configuration).hexdigest(), metrics, 60.0, "a machine", {"usvnet": "0", "torch": "0"})
write_result(folder, result)
