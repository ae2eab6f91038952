"""The error budget of a dataset's camera."""

from dataclasses import replace

import numpy as np
import pytest

from usvnet.evaluation.html import camera_study
from usvnet.evaluation.html.camera_study import study_commonest_camera
from usvnet.evaluation.sensitivity import ALL, Study


@pytest.fixture
def asked(monkeypatch):
    """What the study is asked, which is not worked out."""
    calls = []

    def start(self, settings, camera, hull):
        calls.append((settings, camera))

    monkeypatch.setattr(Study, "__init__", start)
    monkeypatch.setattr(Study, "budget", lambda self: [])
    monkeypatch.setattr(Study, "curves", lambda self: [])
    return calls


def test_the_camera_of_most_pictures_is_studied_where_it_sees_boats(dataset, asked):
    frames = list(dataset.frames)
    frames[0] = replace(frames[0], camera=frames[0].camera._replace(height_m=frames[0].camera.height_m + 1))
    pitches = (0.0, 0.05, 0.10, 0.30)
    frames = [
        replace(
            frame, camera=frame.camera._replace(pitch_rad=frame.camera.pitch_rad * 0 + pitch), range_m=np.array([8.0])
        )
        for frame, pitch in zip(frames, pitches)
    ]
    study = study_commonest_camera(frames)
    ((settings, camera),) = asked
    assert float(camera.height_m) == 1.5
    assert float(camera.pitch_rad) == pytest.approx(0.10)
    assert settings.distances_m == (5.0, 10.0), "nearer is below the picture, farther than any reading by half"
    assert "took 3 of 4 pictures" in study.camera
    assert "320 x 280 px, focal length 400 px, 1.50 m above the water" in study.camera


def test_a_camera_that_sees_no_water_has_no_budget(dataset, asked):
    frame = dataset.frames[0]
    up = replace(frame, camera=frame.camera._replace(pitch_rad=frame.camera.pitch_rad - 1.2))
    assert study_commonest_camera([up]) is None
    assert study_commonest_camera([]) is None
    assert asked == []


def test_the_budget_is_that_of_the_settings(dataset, monkeypatch):
    monkeypatch.setattr(camera_study, "CURVES", {"pitch_deg": (0.1,)})
    study = study_commonest_camera(dataset.frames)
    assert {cost.source for cost in study.budget} == {"keypoint_px", "pitch_deg", ALL}
    assert {cost.source for cost in study.curves} == {"pitch_deg"}
