"""Boats keep their numbers through missed frames, false alarms and each other's way."""

import math

import numpy as np
import pytest

from tracking.simulated_boats import Sea
from usvnet.tracking.filter import Sighting
from usvnet.tracking.tracker import Tracker, TrackingConfig, track_of

CONFIG = TrackingConfig(lasting_share=0.0, wander_m_s=0.1)
CROSSING = [(-8.0, 30.0, 2.0, 0.0), (8.0, 30.6, -2.0, 0.0), (0.0, 50.0, 0.0, -2.0)]


def at(bearing_rad, range_m, ranged=True):
    inverse = 1 / range_m if ranged else math.nan
    return Sighting(bearing_rad, 0.002, inverse, 0.03 / range_m if ranged else math.nan, 0.0)


def test_crossing_boats_among_missed_and_false_detections():
    rng = np.random.default_rng(1)
    sea, tracker = Sea(CROSSING, rng, wander_m_s=0.02), Tracker(CONFIG)
    owners, nees, time_s = {}, [], 0.0
    for _ in range(110):
        dt_s = rng.uniform(0.02, 0.13)
        time_s += dt_s
        sea.advance(dt_s)
        seen = [(boat, sighting) for boat, sighting in enumerate(sea.sight()) if rng.random() < 0.85]
        if rng.random() < 0.3:
            seen.append((None, at(rng.uniform(-0.6, 0.6), rng.uniform(5, 80))))
        rng.shuffle(seen)
        tracks = tracker.step(time_s, [sighting for _, sighting in seen])
        for track in tracks:
            if track.sighting is not None and seen[track.sighting][0] is not None:
                owners.setdefault(track.number, []).append(seen[track.sighting][0])
        for track in tracks:
            boat = owners.get(track.number, [None])[0]
            if boat is not None:
                error = sea.motions[boat] - track.motion
                nees.append(error @ np.linalg.solve(track.motion_covariance, error))
    assert sorted({max(set(boats), key=boats.count) for boats in owners.values()}) == [0, 1, 2]
    assert len(owners) == tracker.confirmed == 3
    for boats in owners.values():
        assert boats.count(boats[0]) / len(boats) > 0.97
    assert np.median(nees) < 7.8  # 90 % quantile of chi-squared with 4 degrees of freedom


@pytest.mark.parametrize("lasting_share", [0.0, 0.9])
def test_boats_are_told_apart_however_long_their_errors_last(lasting_share):
    """The rules believe in a half: a boat must not break in two where it is none or nearly all."""
    sea = Sea(CROSSING[:1], np.random.default_rng(2), lasting_share=lasting_share)
    tracker = Tracker(TrackingConfig(wander_m_s=0.1))
    for n in range(150):
        sea.advance(0.05)
        tracks = tracker.step(0.05 * n, sea.sight())
    assert tracker.confirmed == len(tracks) == 1


def test_a_boat_is_confirmed_when_it_was_seen_often_enough():
    tracker = Tracker(TrackingConfig(confirm_hits=3, confirm_frames=5))
    seen = [True, False, True, False, True]
    numbers = [[track.number for track in tracker.step(0.1 * n, [at(0.0, 20.0)] * s)] for n, s in enumerate(seen)]
    assert numbers == [[], [], [], [], [1]]
    tracker = Tracker(TrackingConfig(confirm_hits=3, confirm_frames=5))
    seen = [True, False, False, False, True, True]
    assert all(not tracker.step(0.1 * n, [at(0.0, 20.0)] * s) for n, s in enumerate(seen))


def test_a_boat_that_is_not_seen_is_believed_in_for_a_while():
    tracker = Tracker(TrackingConfig(lost_s=1.0))
    for n in range(10):
        tracks = tracker.step(0.1 * n, [at(0.0, 20.0)])
    assert (tracks[0].number, tracks[0].sighting, tracks[0].age_s) == (1, 0, pytest.approx(0.9))
    before = tracks[0].range_std_m
    (track,) = tracker.step(1.7, [])
    assert (track.sighting, track.unseen_s) == (None, pytest.approx(0.8))
    assert track.range_std_m > before
    assert tracker.step(2.0, []) == []


def test_a_long_gap_begins_anew_with_a_new_number():
    tracker = Tracker(TrackingConfig(lost_s=1.0))
    for start_s in (0.0, 60.0):
        for n in range(4):
            tracks = tracker.step(start_s + 0.1 * n, [at(0.0, 20.0)])
    assert [track.number for track in tracks] == [2]


def test_frames_of_the_same_time_or_an_earlier_one_do_no_harm():
    tracker = Tracker()
    for time_s in (0.0, 0.1, 0.1, 0.05, 0.2, 0.3):
        tracks = tracker.step(time_s, [at(0.1, 25.0)])
    assert tracks[0].number == 1
    assert tracks[0].range_m == pytest.approx(25.0, rel=1e-6)
    assert np.isfinite(tracks[0].motion_covariance).all()


def test_a_boat_without_a_range_keeps_its_number_but_begins_none():
    tracker = Tracker()
    assert all(not tracker.step(0.1 * n, [at(0.3, 20.0, ranged=False)]) for n in range(6))
    for n in range(6, 16):
        tracks = tracker.step(0.1 * n, [at(0.3, 20.0, ranged=n < 10), at(-0.3, 30.0)])
    assert [track.sighting for track in tracks] == [0, 1]
    assert track_of(tracks, 1) is tracks[1]
    assert track_of(tracks, 2) is None


def test_a_closing_boat_says_when_and_how_near():
    tracker = Tracker(CONFIG)
    for n in range(60):
        time_s = 0.1 * n
        x, z = 5.0, 60.0 - 4.0 * time_s
        (tracks) = tracker.step(time_s, [at(math.atan2(x, z), math.hypot(x, z))])
    (track,) = tracks
    assert track.closing_m_s == pytest.approx(4.0 * z / math.hypot(x, z), abs=3 * track.closing_std_m_s)
    assert track.encounter.cpa_m == pytest.approx(5.0, abs=3 * track.encounter.cpa_std_m)
    assert track.encounter.tcpa_s == pytest.approx(z / 4.0, abs=3 * track.encounter.tcpa_std_s)
    assert track.low_90_m < track.range_m < track.high_90_m
    assert len(track.trail_m) == 58  # since it was confirmed
    np.testing.assert_allclose(track.trail_m[-1], track.motion[:2])


@pytest.mark.parametrize(
    ("rules", "sentence"),
    [
        ({"confirm_hits": 6}, "confirm_hits: got 6, expected 1 to confirm_frames"),
        ({"gate_probability": 1.0}, "gate_probability: got 1"),
        ({"lost_s": 0.0}, "lost_s: got 0"),
        ({"camera_correlation_s": math.inf}, "camera_correlation_s: got inf"),
        ({"lasting_share": 1.0}, "lasting_share: got 1, expected from 0 to below 1"),
    ],
)
def test_rules_that_make_no_sense(rules, sentence):
    with pytest.raises(ValueError, match=rf"tracking\.{sentence}"):
        TrackingConfig(**rules)


def test_a_clock_that_is_set_back_begins_anew():
    tracker = Tracker(TrackingConfig(lost_s=1.0))
    for start_s in (100.0, 0.0):
        for n in range(6):
            tracks = tracker.step(start_s + 0.1 * n, [at(0.0, 20.0 + n)])
    (track,) = tracks
    assert (track.number, track.sighting, track.age_s) == (2, 0, pytest.approx(0.5))
    assert track.motion[3] > 2  # it recedes by 10 m/s, seen for half a second


def test_a_sighting_of_no_bearing_is_of_no_boat():
    tracker = Tracker()
    for n in range(6):
        tracks = tracker.step(0.1 * n, [Sighting(*[math.nan] * 5)] if n == 5 else [at(0.0, 20.0)])
    assert [(track.number, track.sighting) for track in tracks] == [(1, None)]
