import pytest
import torch

from usvnet.geometry.hull_files import load_hull, save_hull
from usvnet.types import KEYPOINT_NAMES


def test_written_hull_loads_back_identically(tmp_path):
    torch.manual_seed(0)
    keypoints = torch.randn(7, 3)
    save_hull(keypoints, tmp_path / "hull.yaml")
    assert torch.equal(load_hull(tmp_path / "hull.yaml"), keypoints)


def test_keypoints_come_in_the_packages_order(tmp_path):
    lines = [f"  {name}: [{index}, 0.5, 1e-3]" for index, name in enumerate(KEYPOINT_NAMES)]
    path = tmp_path / "hull.yaml"
    path.write_text("\n".join(["keypoints:", *reversed(lines)]))
    torch.testing.assert_close(load_hull(path), torch.tensor([[i, 0.5, 0.001] for i in range(7)]))


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (("bow:", "beak:"), "hull.yaml: keypoints: unknown key 'beak'"),
        (("  bow: [0.0, 0.0, 0.0]\n", ""), "hull.yaml: keypoints: bow is missing"),
        (("bow: [0.0, 0.0, 0.0]", "bow: [0.0, 0.0]"), "hull.yaml: keypoints: bow: expected x, y and z, got 2"),
        (("bow: [0.0, 0.0, 0.0]", "bow: [0.0, 0.0, .nan]"), "hull.yaml: keypoints: bow: expected a finite number"),
        (("keypoints:", "points:"), "hull.yaml: keypoints is missing"),
    ],
)
def test_bad_hull_files_name_file_and_key(tmp_path, edit, sentence):
    path = tmp_path / "hull.yaml"
    save_hull(torch.zeros(7, 3), path)
    path.write_text(path.read_text().replace(*edit))
    with pytest.raises(ValueError, match=sentence):
        load_hull(path)


def test_no_hull_is_written_from_bad_numbers(tmp_path):
    for bad in (torch.zeros(6, 3), torch.full((7, 3), torch.inf)):
        with pytest.raises(ValueError, match="expected 7 x 3 finite numbers"):
            save_hull(bad, tmp_path / "hull.yaml")
    assert not any(tmp_path.iterdir())
