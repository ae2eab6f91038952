"""What every test shares: one thread a process, and where the working data lies."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch: several processes on few cores spin otherwise

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from small_exports import write_cvat, write_label_studio, write_scene_folder

from usvnet.model import USVNet

torch.set_num_threads(1)

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of working data beside the checkout; the test is skipped where there is none."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("no folder `shared` with the working data beside the checkout")
    return folder


@pytest.fixture(scope="session")
def sixscenes(shared: Path) -> Path:
    """The rendered dataset sixscenes-v0."""
    folder = shared / "data" / "sixscenes-v0"
    if not folder.is_dir():
        pytest.skip("no data/sixscenes-v0 in the folder `shared` beside the checkout")
    return folder


@pytest.fixture(scope="session")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint of size n that has learnt nothing."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("untrained") / "best.ckpt"
    weights = {f"model.{name}": value for name, value in USVNet("n").state_dict().items()}
    torch.save({"usvnet": {"variant": "n", "curved_water": False}, "state_dict": weights}, path)
    return path


@pytest.fixture
def cvat(tmp_path: Path) -> Path:
    """An unpacked export of CVAT."""
    return write_cvat(tmp_path / "cvat")


@pytest.fixture
def label_studio(tmp_path: Path) -> Path:
    """Label Studio's JSON file, pictures beside it."""
    return write_label_studio(tmp_path / "studio")


@pytest.fixture
def scene_folder(tmp_path: Path) -> Path:
    """Pictures by scene, with their labels and laser ranges."""
    return write_scene_folder(tmp_path / "scenes")


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Lightning switches Ctrl-C off while it shuts down; switch it on again."""
    handler = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, handler)
