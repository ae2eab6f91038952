from pathlib import Path

import pytest
import yaml

from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import load_settings
from usvnet.simulator.typed_yaml import Range

CONFIGS = Path(__file__).resolve().parents[2] / "configs" / "simulator"
DATASETS = ("paper", "diverse", "far", "shift", "mine")
SMALL = """
seed: 5
frames: {train: 6, val: 3, test: 1}
cameras:
  bow: {size_px: [640, 480], focal_px: 700, mount: {height_m: 1.5, pitch_deg: 6}}
hulls:
  usv: {family: mono, length_m: 1.2}
laser: {std_m: 0.01}
scenes:
  sun:
    distance_m: [5, 15]
    skies: [{kind: clear, sun_elevation_deg: [10, 40]}]
    sea: {slope_std: 0.05, peak_wavelength_m: [0.5, 4], colours_rgb: [[0.01, 0.03, 0.03]]}
    shore: {kinds: {none: 1}, distance_m: [50, 300]}
    air: {visibility_m: [5000, 30000]}
    exposure: {key: 0.2, noise_gain: 0.001}
"""


def write(folder: Path, **changes: object) -> Path:
    """The small dataset with some keys changed; ``scenes__sun__sea`` is a key in keys, and ... takes one away."""
    content = yaml.safe_load(SMALL)
    for key, value in changes.items():
        *parents, last = key.split("__")
        place = content
        for parent in parents:
            place = place[parent]
        if value is ...:
            del place[last]
        else:
            place[last] = value
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize("name", DATASETS)
def test_shipped_datasets_load_and_draw(name):
    scenario = Scenario(load_settings(CONFIGS / f"{name}.yaml"))
    for number in (0, scenario.total // 2, scenario.total - 1):
        assert scenario.frame(number).number == number


def test_every_dataset_that_ships_is_tested():
    files = {path.stem for path in CONFIGS.glob("*.yaml")}
    assert files == {*DATASETS, "mine-camera", "mine-hull"}


def test_values_arrive(tmp_path):
    settings = load_settings(write(tmp_path, scenes__sun__tag="I", cameras__bow__imu_std_deg=0.2))
    assert settings.seed == 5
    assert (settings.frames.train, settings.frames.total) == (6, 10)
    assert settings.cameras["bow"].size_px == (640, 480)
    assert settings.cameras["bow"].focal_px == Range(700, 700)
    assert settings.cameras["bow"].imu_std_deg == 0.2
    scene = settings.scenes["sun"]
    assert (scene.tag, scene.distance_m, scene.sea.slope_std) == ("I", Range(5, 15), Range(0.05, 0.05))
    assert scene.skies[0].sun_elevation_deg == Range(10, 40)


def test_paths_are_relative_to_the_file(tmp_path):
    (tmp_path / "boat.obj").write_text("v 0 0 0\n")
    (tmp_path / "hull.yaml").write_text((CONFIGS / "mine-hull.yaml").read_text())
    mesh = {"family": "mesh", "mesh_file": "boat.obj", "keypoints_file": "hull.yaml"}
    hull = Scenario(load_settings(write(tmp_path, hulls__usv=mesh))).hulls()["usv"]
    assert hull.mesh_file == tmp_path / "boat.obj"
    assert hull.keypoints_m is not None
    assert hull.keypoints_m[0] == pytest.approx((0.6, 0, 0.2))
    assert hull.length_m == pytest.approx(1.2)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.yaml: no such file"):
        load_settings(tmp_path / "nowhere.yaml")


BOW = {"size_px": [640, 480], "focal_px": 700, "mount": {"height_m": 1.5, "pitch_deg": 6}}


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"colour": 1}, r"unknown key 'colour'; expected one of frames, "),
        ({"scenes__sun__sea__slope": 0.1}, r"scenes: sun: sea: unknown key 'slope'; expected one of slope_std"),
        ({"frames": ...}, r"small\.yaml: frames is missing"),
        ({"scenes__sun__exposure__key": ...}, r"scenes: sun: exposure: key is missing"),
        ({"seed": "many"}, r"seed: expected a finite number, got 'many'"),
        ({"seed": 1.5}, r"seed: expected a whole number, got 1\.5"),
        ({"seed": -1}, r"seed: expected a number of at least 0, got -1"),
        ({"cameras": [1]}, r"cameras: expected a mapping"),
        ({"cameras": {}}, r"cameras: expected shares of at least 0 and one above 0"),
        ({"frames": {"train": 0}}, r"frames: expected at least one frame in train, val, test"),
        ({"frames": {"dev": 5}}, r"frames: unknown key 'dev'; expected one of train, val, test"),
        ({"scenes__sun__distance_m": [15, 5]}, r"scenes: sun: distance_m: expected \[low, high\], got \[15, 5\]"),
        ({"scenes__sun__distance_m": [1, 2, 3]}, r"distance_m: expected a number or \[low, high\], got 3 numbers"),
        ({"scenes__sun__distance_m": [0, 5]}, r"distance_m: expected a number between 1 and 1000, got 0"),
        ({"scenes__sun__skies": []}, r"scenes: sun: skies: expected shares of at least 0 and one above 0"),
        ({"scenes__sun__skies": 3}, r"scenes: sun: skies: expected a list, got 3"),
        (
            {"scenes__sun__skies": [{"kind": "night", "sun_elevation_deg": 3}]},
            r"skies\[0\]: kind: expected one of clear, overcast, dusk, fog, got 'night'",
        ),
        ({"scenes__sun__shore__kinds": {"cliff": 1}}, r"shore: kinds: expected one of none, trees, .* got 'cliff'"),
        ({"scenes__sun__shore__kinds": {"trees": -1}}, r"shore: kinds: expected shares of at least 0"),
        ({"scenes__sun__air": {}}, r"air: expected either visibility_m or visibility_boats"),
        ({"scenes__sun__clutter": {"buoy": [0, 1.5]}}, r"clutter: buoy: expected whole numbers between 0 and 20"),
        ({"scenes__sun__hulls": ["ark"]}, r"scenes: sun: hulls: expected some of usv, got 'ark'"),
        ({"scenes__sun__tag": 1}, r"scenes: sun: tag: expected text, got 1"),
        ({"scenes__sun__sea__colours_rgb": [[0, 0]]}, r"colours_rgb\[0\]: expected 3 values, got 2"),
        ({"scenes__sun__sea__colours_rgb": [[0, 0, 30]]}, r"colours_rgb: expected numbers between 0 and 1"),
        ({"boats": {"per_frame": [0.5, 0.6]}}, r"boats: per_frame: expected probabilities of 0 to at most 8 boats"),
        ({"boats": {"truncated_share": 1.2}}, r"boats: truncated_share: expected a number between 0 and 1, got 1\.2"),
        ({"laser": {"std_m": 0.01, "test": 2}}, r"laser: test: expected a number between 0 and 1, got 2"),
        ({"cameras__bow__hfov_deg": 50}, r"cameras: bow: expected either focal_px or hfov_deg"),
        ({"cameras__bow__mount": ...}, r"cameras: bow: mount is missing \(or a camera file under file\)"),
        ({"cameras__bow__size_px": [640]}, r"cameras: bow: size_px: expected 2 values, got 1"),
        ({"cameras__bow__file": "no.yaml"}, r"cameras: bow: size_px: the camera file says that"),
        ({"cameras__bow": {"file": "no.yaml"}}, r"cameras: bow: file: no such file: .*no\.yaml"),
        ({"cameras": {"a b": BOW}}, r"cameras: expected names of letters, digits, - and _, got 'a b'"),
        ({"hulls__usv": {"family": "mono"}}, r"hulls: usv: length_m: expected for every family but mesh"),
        ({"hulls__usv": {"family": "mesh"}}, r"hulls: usv: mesh_file: expected for the family mesh"),
        ({"hulls__usv__family": "canoe"}, r"hulls: usv: family: expected one of mono, .* got 'canoe'"),
        ({"hulls__usv__share": 0}, r"hulls: expected shares of at least 0 and one above 0"),
    ],
)
def test_what_is_wrong_is_one_sentence_with_file_and_key(tmp_path, changes, sentence):
    with pytest.raises(ValueError, match=sentence) as error:
        load_settings(write(tmp_path, **changes))
    assert str(error.value).startswith(f"{tmp_path / 'small.yaml'}: ")
    assert "\n" not in str(error.value)


def test_a_folding_lens_is_refused(tmp_path):
    path = write(tmp_path, cameras__bow__distortion={"k1": -1}, cameras__bow__focal_px=300)
    with pytest.raises(ValueError, match="cameras: bow: distortion: the lens model folds over inside the picture"):
        Scenario(load_settings(path))


def test_two_cameras_of_one_name_are_refused(tmp_path):
    path = write(tmp_path, cameras={"a": {**BOW, "count": 2}, "a-0": BOW})
    with pytest.raises(ValueError, match="cameras: two are called a-0"):
        Scenario(load_settings(path))
