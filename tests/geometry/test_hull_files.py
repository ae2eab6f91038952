import pytest
import torch

from usvnet.geometry.hull_files import load_hull, save_hull
from usvnet.types import KEYPOINT_NAMES, Hull

BOAT_M = torch.tensor(
    [[0.7, 0, 0.2], [0.4, 0.1, 0.2], [0.4, -0.1, 0.2], [0.6, 0, 0], [-0.7, 0.1, 0.1], [-0.7, -0.1, 0.1], [-0.7, 0, 0]]
)


def exact(points_m: torch.Tensor) -> Hull:
    return Hull(points_m[None], scale_std=torch.zeros(1), point_std_m=torch.zeros(1))


def test_written_hull_loads_back_identically(tmp_path):
    torch.manual_seed(0)
    hull = Hull((BOAT_M + 0.01 * torch.rand(7, 3))[None], *torch.rand(2, 1))
    save_hull(hull, tmp_path / "hull.yaml")
    assert all(torch.equal(a, b) for a, b in zip(load_hull(tmp_path / "hull.yaml"), hull, strict=True))


def test_keypoints_come_in_the_packages_order(tmp_path):
    lines = [f"  {name}: {point.tolist()}" for name, point in zip(KEYPOINT_NAMES, BOAT_M.double())]
    path = tmp_path / "hull.yaml"
    path.write_text("\n".join(["keypoints:", *reversed(lines)]))
    hull = load_hull(path)
    torch.testing.assert_close(hull.points_m, BOAT_M[None])
    assert hull.scale_std.item() == hull.point_std_m.item() == 0


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (("bow:", "beak:"), "hull.yaml: keypoints: unknown key 'beak'"),
        (("  bow: [0.7, 0.0, 0.2]\n", ""), "hull.yaml: keypoints: bow is missing"),
        (("bow: [0.7, 0.0, 0.2]", "bow: [0.7, 0.2]"), "hull.yaml: keypoints: bow: expected x, y and z, got 2"),
        (("bow: [0.7, 0.0, 0.2]", "bow: [0.7, 0.0, .nan]"), "hull.yaml: keypoints: bow: expected a finite number"),
        (("keypoints:", "points:"), "hull.yaml: keypoints is missing"),
        (("scale_std:", "scale_sdt:"), "hull.yaml: unknown key 'scale_sdt'; expected one of keypoints, scale_std"),
        (("scale_std: 0.0", "scale_std: -0.1"), "hull.yaml: scale_std: expected a standard deviation of at least 0"),
        (("point_std_m: 0.0", "point_std_m: wide"), "hull.yaml: point_std_m: expected a finite number"),
        (
            ("bow: [0.7,", "bow: [700,"),
            "keypoints: bow lies 700.7 m ahead of stern_bottom, expected 0.1 to 200",
        ),
        (("bow_left: [0.4, 0.1,", "bow_left: [0.4, -0.2,"), "expected greater y of bow_left and stern_left"),
        (("bow_bottom: [0.6,", "bow_bottom: [-0.8,"), "expected bow_bottom at greater x than stern_bottom"),
        (("stern_bottom: [-0.7, 0.0, 0.0]", "stern_bottom: [-0.7, 0.0, 0.25]"), "stern_bottom: z is 0.25, expected 0"),
    ],
)
def test_bad_hull_files_name_file_and_key(tmp_path, edit, sentence):
    path = tmp_path / "hull.yaml"
    save_hull(exact(BOAT_M), path)
    path.write_text(path.read_text().replace(*edit))
    with pytest.raises(ValueError, match=sentence):
        load_hull(path)


def test_no_hull_is_written_from_bad_numbers(tmp_path):
    for bad in (torch.zeros(6, 3), torch.full((7, 3), torch.inf)):
        with pytest.raises(ValueError, match="expected one hull of 7 x 3 finite numbers"):
            save_hull(exact(bad), tmp_path / "hull.yaml")
    assert not any(tmp_path.iterdir())
