"""Settings of a dataset with pictures of 64 pixels, and a run of it with the fake renderer."""

from pathlib import Path

from usvnet.commands.simulate import finish_dataset
from usvnet.simulator.run import Summary, simulate_dataset

SETTINGS = """\
seed: 7
frames: {train: 14, val: 6, test: 4}
laser: {std_m: 0.02, train: 0.5}
boats: {per_frame: [0.2, 0.5, 0.3], truncated_share: 0.2, length_px: [4, 400], moving_share: 0.5}
cameras:
  mast: &camera
    size_px: [64, 64]
    focal_px: 60
    mount: {height_m: [1.5, 2], pitch_deg: 9, pitch_std_deg: 0.6, roll_std_deg: 0.8}
    imu_std_deg: 0.05
    count: 2
  quay:
    size_px: [96, 64]
    focal_px: 70
    distortion: {k1: -0.1}
    mount: {height_m: 2, pitch_deg: 8}
    readout_s: 0.02
    turn_rate_std_deg_s: 5
hulls:
  racer: {family: mono, length_m: [1, 2], count: 3}
  twin: {family: catamaran, length_m: 2}
scenes:
  near: &scene
    tag: I
    distance_m: [9, 14]
    skies: [{kind: clear, sun_elevation_deg: [20, 50], sun_strength: [4, 9], cloud_cover: [0, 1]}]
    sea: {slope_std: [0.03, 0.1], peak_wavelength_m: [1, 4], colours_rgb: [[0.01, 0.02, 0.02]], foam: [0, 0.02]}
    shore: {kinds: {trees: 1, none: 1}, distance_m: [60, 200]}
    air: {visibility_m: [5000, 20000]}
    exposure: {key: [0.1, 0.2], noise_gain: [0.0005, 0.001], time_s: [0.001, 0.01]}
    clutter: {buoy: [0, 2]}
  fog:
    <<: *scene
    tag: V
    skies: [{kind: fog, sun_elevation_deg: 30}]
    air: {visibility_boats: [1, 2], rain_share: 0.5}
"""
TOTAL = 24


def write_settings(folder: Path, text: str = SETTINGS) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "small.yaml").write_text(text)
    return folder / "small.yaml"


def simulate_small(config: Path, root: Path, **options: object) -> Summary:
    settings = {"engine": "fake", "workers": 1, "render": "fake_renderer.render_frame", **options}
    return simulate_dataset(config, root, finish_dataset, **settings)


def files_of(root: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}
