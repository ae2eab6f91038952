"""Photographs of boats on water, with labels that are exact.

The path of a frame::

    settings (a YAML file) ─ scenario ─ FrameSpec ─┬─ hulls, water, sky, shore, clutter     triangles and a sky
                                                   └─ Camera ─ optics                       rays and pixels
    triangles ─ scene ─ engine (Mitsuba 3) ─ radiance, depth, masks ─ air ─ optics ─ sensor ─ picture
    hull, water, Camera ─ labels                                                     keypoints, boxes, ranges
    picture + labels ─ dataset_writer                                                files

The world frame of the simulator: x right, y forward, z up, in metres; the mean water is z = 0 and the camera's
optical centre stands at (0, 0, height_m). Hull frame: x forward, y to port, z up, origin amidships on the resting
waterline. Colours are linear RGB.
"""
