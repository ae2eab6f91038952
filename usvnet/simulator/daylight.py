"""The colours of a cloudless day: the sky of Preetham et al. and the sun through the air."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

PEREZ = np.array(
    [
        [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
"""(3, 5, 2) slope and offset in turbidity of the coefficients A to E of Y, x and y (Preetham et al. 1999, A.2)."""
ZENITH = np.array(
    [
        [
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ],
        [
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ],
    ]
)
"""(2, 3, 4) the zenith's x and y: powers 2 to 0 of turbidity times powers 3 to 0 of the sun's zenith angle (A.2)."""
TURBIDITY_LIMITS = (2.0, 6.0)
"""Where the model was fitted; outside it the horizon turns green or dark."""
PALE_HORIZON = (0.90, 1.0, 1.10)
"""Colour of haze by day; the model's own is too pink (Zotti, Wilkie and Purgathofer 2007)."""
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
WAVELENGTHS_UM = np.array([0.61, 0.55, 0.465])
"""Where the three channels of a picture look, micrometres."""


def perez(coefficients: NDArray, cos_zenith: NDArray, angle_rad: NDArray, cos_angle: NDArray) -> NDArray:
    """The sky's luminance distribution of Perez et al. 1993, for coefficients A to E (5,)."""
    a, b, c, d, e = (np.float32(number) for number in coefficients)
    return (1 + a * np.exp(b / cos_zenith)) * (1 + c * np.exp(d * angle_rad) + e * cos_angle**2)


def clear_sky(up: NDArray, cos_to_sun: NDArray, sun_elevation_rad: float, turbidity: float) -> Floats:
    """Radiance (..., 3) of a cloudless sky, linear RGB, 1 is 1 kcd/m^2 (Preetham, Shirley and Smits 1999).

    Args:
        up: (...) sine of the elevation that is looked at; below 0.01 it is taken as 0.01.
        cos_to_sun: (...) cosine of the angle to the sun.
        sun_elevation_rad: a sun below the horizon is taken as at the horizon.
        turbidity: taken into ``TURBIDITY_LIMITS``.
    """
    T = float(np.clip(turbidity, *TURBIDITY_LIMITS))
    sun_zenith = np.pi / 2 - max(sun_elevation_rad, 0.0)
    coefficients = PEREZ @ [T, 1]
    zenith_xy = ZENITH @ sun_zenith ** np.arange(3, -1, -1) @ [T * T, T, 1]
    chi = (4 / 9 - T / 120) * (np.pi - 2 * sun_zenith)
    zenith = [(4.0453 * T - 4.9710) * np.tan(chi) - 0.2155 * T + 2.4192, *zenith_xy]
    cos_zenith = np.maximum(up, 0.01).astype(np.float32)
    cos_angle = np.clip(cos_to_sun, -1, 1).astype(np.float32)
    angle = np.arccos(cos_angle)
    overhead = np.ones(1), np.array([sun_zenith]), np.array([np.cos(sun_zenith)])
    luminance, x, y = (
        np.float32(value / perez(row, *overhead)[0]) * perez(row, cos_zenith, angle, cos_angle)
        for value, row in zip(zenith, coefficients)
    )
    scale = np.maximum(luminance, 0) / np.maximum(y, 0.05)
    XYZ = np.stack([x * scale, y * scale, (1 - x - y) * scale], -1).astype(np.float32)
    rgb = np.maximum(XYZ @ XYZ_TO_RGB.T.astype(np.float32), 0)
    day = np.clip((np.degrees(sun_elevation_rad) - 4) / 16, 0, 1)
    pale = (0.9 * day * np.exp(-cos_zenith / 0.2))[..., None].astype(np.float32)
    return rgb + pale * (XYZ[..., 1:2] * np.array(PALE_HORIZON, np.float32) - rgb)


def sun_colour(elevation_rad: float, turbidity: float) -> Floats:
    """Colour (3,) of the sun's light, linear RGB of luminance 1: white when high, warm when low.

    Rayleigh's and the aerosol's extinction along the air mass of Kasten and Young (1989), as in Preetham et al.
    (1999, A.1). A camera's white balance takes half of the tint away.
    """
    elevation_deg = np.degrees(np.clip(elevation_rad, 0, np.pi / 2))
    air_mass = 1 / (np.sin(np.radians(elevation_deg)) + 0.50572 * (elevation_deg + 6.07995) ** -1.6364)
    haze = max(0.04608 * turbidity - 0.04586, 0.0)
    depth = 0.008735 * WAVELENGTHS_UM**-4.08 + haze * WAVELENGTHS_UM**-1.3
    colour = np.exp(-0.5 * depth * air_mass)
    return (colour / luminance(colour)).astype(np.float32)


def luminance(rgb: NDArray) -> NDArray:
    """Luminance (...) of linear RGB (..., 3) (Rec. 709)."""
    return rgb @ np.array([0.2126, 0.7152, 0.0722], np.float32)
