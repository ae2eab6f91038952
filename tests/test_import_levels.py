"""The arrows of the house: every import goes down, and the heavy packages stay in their rooms."""

import ast
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
INTEGRATIONS = ROOT.glob("integrations/**/*.py")
SOURCES = sorted([*ROOT.glob("usvnet/**/*.py"), *ROOT.glob("scripts/*.py"), *ROOT.glob("*.py"), *INTEGRATIONS])

LEVELS = [
    {"__init__", "types", "files", "config", "allocator", "wording"},
    {"geometry", "heatmap", "intervals", "keypoint_noise"},
    {"crops"},
    {"network", "losses", "data", "simulator", "metrics", "tracking"},
    {"model"},
    {"checkpoints", "optimiser", "pretrained", "visualize"},
    {"deploy", "evaluation"},
    {"callbacks"},
    {"training"},
    {"training_cli"},
    {"sweep"},
    {"commands"},
    {"cli"},
    {"train", "evaluate", "scripts", "integrations"},
]
"""A room imports from itself and from the levels above it in this list, never from a neighbour."""

METRICS = {f"usvnet.evaluation.{name}" for name in ("records", "record_json", "pose_metrics", "range_metrics")}
"""Scoring needs arrays only: these stand lower than the rest of their folder."""

TRAINING = [
    *("usvnet/training.py", "usvnet/training_cli.py", "usvnet/callbacks.py", "usvnet/data/datamodule.py"),
    "usvnet/sweep/one_run.py",
]
RENDERING = [
    f"usvnet/simulator/{name}.py" for name in ("engine", "scene", "render", "denoise", "rays", "frame", "labels")
]
ONLY_IN = {
    "lightning": [*TRAINING, "train.py", "evaluate.py"],
    "pytorch_lightning": [],
    "torchvision": [],
    "ultralytics": [],
    "jsonargparse": ["usvnet/cli.py", "usvnet/training_cli.py", "evaluate.py", "scripts/*"],
    "scipy": ["usvnet/tracking/*", "integrations/ros2/usvnet_ros/*"],
    "rclpy": ["integrations/ros2/usvnet_ros/node.py"],
    "jinja2": ["usvnet/evaluation/html/page.py"],
    "pycocotools": ["usvnet/evaluation/*", "usvnet/data/*"],
    "matplotlib": ["usvnet/evaluation/*", "usvnet/data/*", "usvnet/commands/*", "usvnet/sweep/figure.py", "scripts/*"],
    **{name: [] for name in ("onnx", "onnxruntime", "openvino")},  # asked for by name, in usvnet/deploy/runtimes.py
    "ray": ["usvnet/sweep/ray_tune.py"],
    "cv2": [
        *("usvnet/geometry/calibration*.py", "usvnet/geometry/chessboard.py"),
        *("usvnet/data/*", "usvnet/evaluation/*", "usvnet/commands/*", "usvnet/visualize/*", "usvnet/callbacks.py"),
        *(f"usvnet/deploy/{name}.py" for name in ("sources", "streams", "annotated", "video_writer")),
        *("usvnet/simulator/*", "scripts/*", "integrations/ros2/usvnet_ros/images.py"),
    ],
    **dict.fromkeys(("mitsuba", "drjit", "pyoidn"), RENDERING),
    "kornia": ["usvnet/geometry/*", "usvnet/heatmap.py", "usvnet/data/*"],
}
"""Third-party packages that may be imported in these files only."""

MAX_LINES = 400
MAX_SCRIPT_LINES = 80


def imported_modules(source: str) -> set[str]:
    """Every module that ``source`` imports, wherever the import stands; ``from a import b`` counts as ``a.b``."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def room_of(module: str) -> str:
    """``usvnet.geometry.camera`` stands in the room ``geometry``."""
    if any(f"{module}.".startswith(f"{metric}.") for metric in METRICS):
        return "metrics"
    parts = module.split(".")
    if parts[0] != "usvnet":
        return parts[0]
    return parts[1] if len(parts) > 1 and any(parts[1] in rooms for rooms in LEVELS) else "__init__"


def level_of(room: str) -> int:
    for level, rooms in enumerate(LEVELS):
        if room in rooms:
            return level
    raise AssertionError(f"{room} stands in no level: add it to LEVELS where it belongs")


def faults(path: str, source: str) -> list[str]:
    """What the imports of the file ``path`` (relative to the repository) do wrong."""
    room = room_of(path.removesuffix(".py").replace("/", "."))
    found = []
    for module in sorted(imported_modules(source)):
        package = module.split(".")[0]
        if package == "usvnet":
            other = room_of(module)
            if other != room and level_of(other) >= level_of(room):
                found.append(f"{path} ({room}) imports {module} ({other}), which does not stand above it")
        elif package in ONLY_IN and not any(fnmatch(path, pattern) for pattern in ONLY_IN[package]):
            found.append(f"{path} imports {package}, which belongs in {ONLY_IN[package] or 'no file'}")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_imports_only_go_down_and_files_stay_short(path):
    source = path.read_text()
    name = path.relative_to(ROOT).as_posix()
    assert faults(name, source) == []
    limit = MAX_SCRIPT_LINES if path.parent == ROOT else MAX_LINES
    assert len(source.splitlines()) <= limit, f"{name} is longer than {limit} lines: split it by purpose"


@pytest.mark.parametrize("path", sorted(ROOT.glob("tests/**/*.py")), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_test_files_stay_short(path):
    assert len(path.read_text().splitlines()) <= MAX_LINES


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("usvnet/heatmap.py", "from usvnet.model import USVNet"),
        ("usvnet/types.py", "from usvnet import heatmap"),
        ("usvnet/network/heads.py", "def f():\n    from usvnet.losses.assigner import assign"),
        ("usvnet/evaluation/pose_metrics.py", "from usvnet.evaluation.report import table"),
        ("usvnet/geometry/camera.py", "import cv2"),
        ("usvnet/geometry/camera.py", "import cv2.aruco as aruco"),
        ("usvnet/model.py", "from lightning.pytorch import LightningModule"),
        ("train.py", "import torchvision.ops"),
    ],
)
def test_a_wrong_import_is_noticed(path, line):
    assert len(faults(path, line)) == 1


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("usvnet/model.py", "from usvnet.heatmap import decode"),
        ("usvnet/geometry/ranging.py", "from usvnet.geometry.camera import project"),
        ("usvnet/evaluation/report.py", "from usvnet.evaluation import pose_metrics"),
        ("usvnet/cli.py", "from usvnet import __version__"),
        ("train.py", "from lightning.pytorch.cli import LightningCLI"),
    ],
)
def test_a_right_import_passes(path, line):
    assert faults(path, line) == []
