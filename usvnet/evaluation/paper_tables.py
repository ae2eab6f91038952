"""Figures printed by Wu et al., J. Mar. Sci. Eng. 2025, 13(6), 1172, to stand beside ours.

They were measured on that paper's own photographs, which are not public: another dataset, the same protocol.
"""

from typing import NamedTuple

SOURCE = "Wu et al., J. Mar. Sci. Eng. 2025, 13(6), 1172"


class PaperPose(NamedTuple):
    """A row of Table 2, OKS sigma 1/7."""

    model: str
    precision: float
    recall: float
    map50: float
    map50_95: float


class PaperFocal(NamedTuple):
    """A column of Table 5, metres."""

    rmse_m: float
    mae_m: float


class PaperRange(NamedTuple):
    """One half of a row of Table 3, metres."""

    mse_m2: float
    rmse_m: float
    mae_m: float


TABLE_2 = (
    PaperPose("YOLOv8-pose", 0.691, 0.602, 0.618, 0.276),
    PaperPose("YOLOv8-pose-P6", 0.883, 0.767, 0.787, 0.518),
    PaperPose("YOLO11n-pose", 0.545, 0.418, 0.322, 0.206),
    PaperPose("YOLO11s-pose", 0.817, 0.697, 0.714, 0.451),
    PaperPose("YOLO11l-pose", 0.917, 0.789, 0.825, 0.567),
    PaperPose("YOLO11x-pose", 0.935, 0.813, 0.890, 0.670),
    PaperPose("YOLO11m-pose", 0.940, 0.845, 0.898, 0.757),
)

TABLE_3 = {
    "box_bottom": {
        "I": PaperRange(0.395, 0.628, 0.508),
        "II": PaperRange(2.395, 1.548, 1.182),
        "III": PaperRange(0.918, 0.958, 0.720),
        "IV": PaperRange(2.859, 1.691, 1.288),
        "V": PaperRange(1.096, 1.047, 0.869),
        "VI": PaperRange(3.173, 1.782, 1.499),
    },
    "waterline": {
        "I": PaperRange(0.284, 0.533, 0.416),
        "II": PaperRange(1.942, 1.394, 1.051),
        "III": PaperRange(0.917, 0.957, 0.716),
        "IV": PaperRange(2.841, 1.686, 1.466),
        "V": PaperRange(0.343, 0.586, 0.470),
        "VI": PaperRange(2.570, 1.603, 1.258),
    },
}
"""Estimator -> scene -> errors: the paper's box and keypoint methods."""

TABLE_4 = {50: 0.524, 60: 0.654, 70: 0.688, 80: 0.719, 90: 0.762, 100: 0.757}
"""Epochs -> mAP50-95 of YOLO11m-pose, OKS sigma 1/7."""

TABLE_5 = {
    0.0: PaperFocal(1.205, 1.078),
    50.0: PaperFocal(1.246, 1.111),
    100.0: PaperFocal(1.294, 1.144),
    150.0: PaperFocal(1.348, 1.174),
}
"""Error of the focal length in pixels -> errors of the paper's keypoint method."""

SCENE_TITLES = {
    "I": "strong light, near",
    "II": "strong light, far",
    "III": "dim, near",
    "IV": "dim, far",
    "V": "fog, near",
    "VI": "fog, far",
}
