"""Paint at the vertices: topside, stripe, boot-top, antifouling, the wet band at the water, grime, and letters."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.hulls.shape import Doubles, Part, Shape, Sign
from usvnet.simulator.meshes import Floats, Mesh, grid_faces, merge
from usvnet.simulator.noise import noise_tile, sample_tile

SCHEMES_SRGB = (
    ((232, 232, 228), (190, 30, 25), (20, 20, 22)),
    ((232, 120, 18), (240, 240, 236), (30, 30, 34)),
    ((24, 62, 130), (236, 236, 236), (140, 30, 22)),
    ((210, 24, 22), (240, 240, 240), (30, 30, 34)),
    ((236, 190, 20), (20, 20, 20), (60, 60, 64)),
    ((96, 104, 112), (220, 220, 220), (110, 32, 26)),
    ((28, 30, 34), (230, 120, 20), (120, 30, 24)),
    ((40, 120, 84), (236, 236, 232), (30, 30, 30)),
)
"""Topside, stripe and bottom."""
BRIGHTEST = 0.85
WINDOW = (0.012, 0.014, 0.018)
LETTER_ROWS_PX = 80
"""Height of the bitmap that letters are drawn in before it is reduced to the vertices of a sign."""


@dataclass(frozen=True)
class Coat:
    """How one boat is painted; colours are linear RGB (3,)."""

    colour: dict[str, Doubles]
    """Of each material, and of stripe, boot, bottom and ink."""
    roughness: dict[str, float]
    bottom_top: float
    """How far the antifouling reaches above the resting waterline, in lengths."""
    stripe: tuple[float, float]
    """Lower and upper edge of the stripe in shares of the freeboard; equal where there is none."""
    wet: float
    """Height of the wet band in lengths."""
    grime: float
    text: str
    """What is written on the sides; empty for nothing."""
    tile: Floats
    """Noise."""


def paint(shape: Shape, paint_seed: int) -> Mesh:
    """The whole boat in one coat; its vertices do not depend on ``paint_seed``."""
    coat = mix_coat(paint_seed)
    meshes = [_painted(part, coat, shape.length_m) for part in shape.parts]
    for sign in shape.signs:
        meshes.append(_lettered(sign, coat, shape.length_m))
    return merge(meshes)


def mix_coat(paint_seed: int) -> Coat:
    """Draw a coat of paint."""
    rng = np.random.default_rng([paint_seed, 105])
    topside, stripe, bottom = (linear(c) for c in SCHEMES_SRGB[rng.integers(len(SCHEMES_SRGB))])
    topside = topside * rng.uniform(0.8, 1.05) * rng.uniform(0.93, 1.07, 3)
    bright = topside.mean() > 0.25
    decks = [(0.62, 0.62, 0.60), (0.35, 0.36, 0.37), (0.10, 0.11, 0.12), tuple(0.8 * topside)]
    colour = {
        "shell": topside,
        "belly": np.array([(0.62, 0.62, 0.60), (0.30, 0.31, 0.32), (0.05, 0.05, 0.055)][rng.integers(3)]),
        "tube": topside,
        "deck": np.array(decks[rng.integers(4)]),
        "trim": np.array([0.03, 0.03, 0.03]) if rng.random() < 0.6 else stripe,
        "cabin": linear((228, 228, 224)) if rng.random() < 0.6 else topside,
        "accent": stripe,
        "panel": np.array([0.010, 0.014, 0.035]),
        "dark": np.array([0.022, 0.023, 0.026]),
        "glass": np.array(WINDOW),
        "metal": np.array([0.55, 0.55, 0.56]),
        "stripe": stripe,
        "boot": linear((20, 20, 22)) if bright else linear((220, 220, 220)),
        "bottom": bottom,
        "ink": linear((20, 20, 20)) if bright else linear((235, 235, 235)),
    }
    gloss = rng.uniform(0.15, 0.5)
    roughness = {"shell": gloss, "belly": gloss, "tube": rng.uniform(0.4, 0.6), "deck": 0.55, "trim": 0.5}
    roughness |= {"cabin": 0.35, "accent": 0.4, "panel": 0.15, "dark": 0.45, "glass": 0.12, "metal": 0.3}
    edge = rng.uniform(0.58, 0.66)
    return Coat(
        colour=colour,
        roughness=roughness,
        bottom_top=0.012 * rng.uniform(0.3, 1.5),
        stripe=(edge, edge + rng.choice([0.0, 0.14, 0.2], p=[0.4, 0.4, 0.2])),
        wet=rng.uniform(0.012, 0.03),
        grime=rng.uniform(0.2, 1.0),
        text=_name(rng) if rng.random() < 0.7 else "",
        tile=noise_tile(256, 2.0, rng, lowest=2),
    )


def linear(srgb: tuple[int, int, int]) -> Doubles:
    """Linear RGB (3,) of 8-bit display values."""
    return np.asarray((np.array(srgb) / 255) ** 2.2, np.float64)


def _name(rng: np.random.Generator) -> str:
    word = ("USV", "USV", "SV", "ASV", "R")[rng.integers(5)]
    return f"{word}-{rng.integers(1, 99):02d}"


def _painted(part: Part, coat: Coat, length_m: float) -> Mesh:
    mesh = part.mesh
    if part.material == "as is":
        return mesh
    colours, roughness = _look(part.material, mesh.vertices_m.astype(np.float64), part.up, coat, length_m)
    return Mesh(mesh.vertices_m, mesh.faces, colours.astype(np.float32), roughness.astype(np.float32))


def _look(material: str, points: Doubles, up: NDArray | None, coat: Coat, length_m: float) -> tuple[Doubles, Doubles]:
    """Colour (V, 3) and roughness (V,) at points (V, 3)."""
    colours = np.tile(coat.colour[material], (len(points), 1))
    roughness = np.full(len(points), coat.roughness[material])
    x, y, z = (points / length_m).T
    if material in ("shell", "belly"):
        assert up is not None
        if material == "shell" and coat.stripe[1] > coat.stripe[0]:
            colours[(up > coat.stripe[0]) & (up < coat.stripe[1])] = coat.colour["stripe"]
        if material == "shell":
            boot = (z > coat.bottom_top) & (z < coat.bottom_top + 0.012)
            colours[boot] = coat.colour["boot"]
        below = z < coat.bottom_top
        colours[below], roughness[below] = coat.colour["bottom"], 0.55
    if material not in ("glass", "panel"):
        dirt, streak = _dirt(x, y, z, coat.tile)
        colours *= 1 - coat.grime * (0.5 * dirt + (0.35 * streak if material in ("shell", "tube") else 0))[:, None]
        roughness += 0.25 * coat.grime * dirt
    # Water darkens what it wets and lays a film on it; waves leave its upper edge uneven.
    edge = coat.wet * (0.6 + 0.8 * sample_tile(coat.tile, 200 * x + 31, 90 * y, smooth=False))
    wet = np.clip((edge - z) / (0.35 * coat.wet), 0, 1)
    colours *= 1 - 0.4 * wet[:, None]
    roughness = roughness * (1 - wet) + 0.1 * wet
    return np.clip(colours, 0.003, BRIGHTEST), np.clip(roughness, 0.05, 1)


def _dirt(x: Doubles, y: Doubles, z: Doubles, tile: Floats) -> tuple[Doubles, Doubles]:
    """Patches of dirt and streaks that ran down, (V,) each, 0 to about 0.5; (x, y, z) in lengths."""
    patch = sample_tile(tile, 120 * x + 40 * y, 300 * z + 120 * y, smooth=False)
    streak = sample_tile(tile, 900 * x + 700 * y, 60 * z + 77, smooth=False)
    return np.clip(patch - 0.45, 0, None).astype(np.float64), np.clip(streak - 0.55, 0, None).astype(np.float64)


def _lettered(sign: Sign, coat: Coat, length_m: float) -> Mesh:
    """The letters of a sign; only cells that a letter touches have triangles, so that nothing covers the hull."""
    rows, columns = sign.up.shape
    points = sign.points_m.reshape(-1, 3)
    colours, roughness = _look(sign.material, points, sign.up.ravel(), coat, length_m)
    ink = write(coat.text, rows, columns).ravel()[:, None]
    faces = grid_faces(rows, columns)
    faces = faces[(ink[faces, 0] > 0.2).any(1)]
    shade = np.clip(colours / np.maximum(coat.colour[sign.material], 1e-3), 0, 1)
    colours = colours * (1 - ink) + coat.colour["ink"] * shade * ink
    return Mesh(
        points.astype(np.float32), faces, np.clip(colours, 0.003, BRIGHTEST).astype(np.float32),
        roughness.astype(np.float32),
    )  # fmt: skip


def write(text: str, rows: int, columns: int) -> Doubles:
    """How much of each vertex (rows, columns) of a sign a letter covers, 0 to 1."""
    height, width = LETTER_ROWS_PX, LETTER_ROWS_PX * columns // rows
    picture = np.zeros((height, width), np.uint8)
    if text:
        font, thick = cv2.FONT_HERSHEY_SIMPLEX, 11
        (wide, tall), _ = cv2.getTextSize(text, font, 1.0, thick)
        scale = min(0.78 * height / tall, 0.92 * width / wide)
        (wide, tall), _ = cv2.getTextSize(text, font, scale, thick)
        cv2.putText(picture, text, ((width - wide) // 2, (height + tall) // 2), font, scale, 255, thick, cv2.LINE_AA)
    return cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64) / 255
