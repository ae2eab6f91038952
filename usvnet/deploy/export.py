"""Writing a model for other programs, compared with what is read back before the file gets its name."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usvnet.deploy.deployed import DeployedUSVNet
from usvnet.deploy.formats import check_takes, format_of
from usvnet.deploy.parity import Parity, check_parity
from usvnet.deploy.predictor import DEFAULT_IMAGE_SIZE_PX
from usvnet.deploy.runtimes import needed, open_runtime
from usvnet.deploy.sidecar import describe, sidecar_path
from usvnet.model import USVNet


def export_model(
    model: USVNet, path: Path | str, score_threshold: float = 0.25, image_size: int | None = None
) -> Parity:
    """Write ``model`` in the format of the suffix, read it back, compare, and write the sidecar beside it.

    Args:
        model: a trained model; it is not changed.
        path: of the file, with one of the suffixes in :data:`usvnet.deploy.formats.FORMATS`.
        score_threshold: lowest score that the file marks as a boat.
        image_size: side of the pictures that the model was trained on, for the sidecar and formats of fixed shapes.

    Returns:
        The greatest differences between the file and the model.

    Raises:
        ValueError: another suffix, one that does not take what the model needs, a library that is not installed, or a
            file that says something else than the model when read back. No file is left in that case.
    """
    path = Path(path)
    kind = format_of(path)
    check_takes(path, model)
    for package in kind.packages:
        needed(package)
    deployed = DeployedUSVNet(model, score_threshold).eval()
    with draft_of(path) as draft:
        kind.write(deployed, draft, image_size or DEFAULT_IMAGE_SIZE_PX)
        parity = check_parity(model, deployed, open_runtime(draft))
        about = describe(model, draft, score_threshold, image_size) | {"parity": parity._asdict()}
        sidecar_path(draft).write_text(json.dumps(about, indent=2) + "\n")
    return parity


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A path in a temporary folder, whose files are moved beside ``path`` on success; none is left on failure."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}.") as folder:
        yield Path(folder) / path.name
        for file in sorted(Path(folder).iterdir()):
            file.replace(path.parent / file.name)
