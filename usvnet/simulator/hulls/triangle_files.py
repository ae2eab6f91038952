"""A user's boat from a file: triangles of Wavefront OBJ (``v`` and ``f``) and of PLY (ascii, binary_little_endian).

OBJ: other keywords than ``v`` and ``f`` say nothing of the shape and are passed over. PLY (Turk 1994): vertices with
x, y and z, perhaps red, green and blue of one byte each; faces as lists of vertex indices.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4", "float": "<f4",
    "double": "<f8", "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2", "int32": "<i4", "uint32": "<u4",
    "float32": "<f4", "float64": "<f8",
}  # fmt: skip
COLOURS = ("red", "green", "blue")
FACE_LISTS = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class Triangles:
    """What a file holds."""

    vertices_m: NDArray[np.float64]
    """(V, 3)"""
    faces: NDArray[np.int64]
    """(F, 3) polygons are cut into fans."""
    colours_srgb: NDArray[np.uint8] | None
    """(V, 3) or None where the file has none."""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[tuple[str, str, str], ...]
    """Name, type, and the type of the count in front of a list or the empty string."""


def read_triangles(path: Path) -> Triangles:
    """Read a file ``.obj`` or ``.ply``.

    Raises:
        ValueError: it cannot be read, or is no such file; the message names the file and the line.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from None
    if path.suffix.lower() not in (".obj", ".ply"):
        raise ValueError(f"{path}: expected a file .obj or .ply")
    vertices, polygons, colours = _read_obj(path, raw) if path.suffix.lower() == ".obj" else _read_ply(path, raw)
    if not polygons:
        raise ValueError(f"{path}: no faces")
    fans = [(line, (ring[0], ring[k], ring[k + 1])) for line, ring in polygons for k in range(1, len(ring) - 1)]
    for line, ring in polygons:
        if len(ring) < 3:
            raise ValueError(f"{line}: a face of {len(ring)} vertices, expected 3 or more")
        if min(ring) < 0 or max(ring) >= len(vertices):
            raise ValueError(f"{line}: a face of a vertex that is not there; there are {len(vertices)}")
    if not np.isfinite(vertices).all():
        raise ValueError(f"{path}: vertex {int(np.argmin(np.isfinite(vertices).all(1))) + 1} is not finite")
    return Triangles(vertices, np.array([corners for _, corners in fans], np.int64), colours)


Polygons = list[tuple[str, list[int]]]
"""Where each was read, and its vertices."""


def _read_obj(path: Path, raw: bytes) -> tuple[NDArray[np.float64], Polygons, None]:
    vertices: list[list[float]] = []
    polygons: Polygons = []
    for number, text in enumerate(raw.decode("utf-8", "replace").splitlines(), start=1):
        words = text.split("#")[0].split()
        line = f"{path}:{number}"
        if words[:1] == ["v"]:
            if len(words) < 4:
                raise ValueError(f"{line}: expected v x y z, got {text.strip()!r}")
            vertices.append(_numbers(line, words[1:4]))
        elif words[:1] == ["f"]:
            ring = [_index(line, word.split("/")[0]) for word in words[1:]]
            if 0 in ring:
                raise ValueError(f"{line}: vertices are counted from 1, got {text.strip()!r}")
            polygons.append((line, [k - 1 if k > 0 else len(vertices) + k for k in ring]))
    return np.array(vertices, np.float64).reshape(-1, 3), polygons, None


def _read_ply(path: Path, raw: bytes) -> tuple[NDArray[np.float64], Polygons, NDArray[np.uint8] | None]:
    form, elements, lines, start = _ply_header(path, raw)
    if form == "ascii":
        tables = _ascii_tables(path, raw[start:], elements, lines)
    else:
        tables = _binary_tables(path, raw[start:], elements)
    points = next((i for i, element in enumerate(elements) if element.name == "vertex"), None)
    rings = next((i for i, element in enumerate(elements) if element.name == "face"), None)
    if points is None or rings is None:
        raise ValueError(f"{path}: expected elements vertex and face")
    names = [name if not counted else "" for name, _, counted in elements[points].properties]
    lists = [k for k, (name, _, counted) in enumerate(elements[rings].properties) if counted and name in FACE_LISTS]
    if not {"x", "y", "z"} <= set(names) or not lists:
        raise ValueError(f"{path}: expected properties x, y, z of vertex and vertex_indices of face")
    columns = np.array([[row[names.index(axis)][0] for axis in "xyz"] for _, row in tables[points]], np.float64)
    colours = None
    types = {name: kind for name, kind, _ in elements[points].properties}
    if all(types.get(name) in ("uchar", "uint8") for name in COLOURS):
        rgb = [[row[names.index(name)][0] for name in COLOURS] for _, row in tables[points]]
        colours = np.clip(np.array(rgb).reshape(-1, 3), 0, 255).astype(np.uint8)
    polygons = [(line, [_whole(line, k) for k in row[lists[0]]]) for line, row in tables[rings]]
    return columns.reshape(-1, 3), polygons, colours


def _ply_header(path: Path, raw: bytes) -> tuple[str, list[_Element], int, int]:
    """The form of the data, its elements, and where it begins: after how many lines and how many bytes."""
    form, elements, start, number = "", list[_Element](), 0, 0
    while True:
        end = raw.find(b"\n", start)
        if end < 0:
            raise ValueError(f"{path}:{number + 1}: the header has no end_header")
        text, start, number = raw[start:end].decode("ascii", "replace").strip(), end + 1, number + 1
        line, words = f"{path}:{number}", text.split()
        if number == 1:
            if text != "ply":
                raise ValueError(f"{line}: expected ply, got {text[:20]!r}")
        elif words == ["end_header"]:
            break
        elif words[:1] == ["format"]:
            if words[1:] not in (["ascii", "1.0"], ["binary_little_endian", "1.0"]):
                raise ValueError(f"{line}: expected format ascii 1.0 or binary_little_endian 1.0, got {text!r}")
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            elements.append(_Element(words[1], int(words[2]), ()))
        elif words[:1] == ["property"] and elements and _is_property(words[1:]):
            counted = words[2] if words[1] == "list" else ""
            last = elements[-1]
            elements[-1] = _Element(last.name, last.count, (*last.properties, (words[-1], words[-2], counted)))
        elif words[:1] not in (["comment"], ["obj_info"]):
            raise ValueError(f"{line}: not understood: {text[:60]!r}")
    if not form:
        raise ValueError(f"{path}: the header has no format")
    return form, elements, number, start


def _is_property(words: list[str]) -> bool:
    if words[:1] == ["list"]:
        return len(words) == 4 and all(word in PLY_TYPES for word in words[1:3]) and PLY_TYPES[words[1]][-2] in "iu"
    return len(words) == 2 and words[0] in PLY_TYPES


Rows = list[tuple[str, list[list[float]]]]
"""Where each row was read, and the values of each of its properties."""


def _ascii_tables(path: Path, raw: bytes, elements: list[_Element], lines: int) -> list[Rows]:
    texts = [
        (f"{path}:{number}", text.split())
        for number, text in enumerate(raw.decode("ascii", "replace").splitlines(), start=lines + 1)
        if text.strip()
    ]
    tables, at = [], 0
    for element in elements:
        rows: Rows = []
        if at + element.count > len(texts):
            raise ValueError(f"{path}: ends before its {element.count} elements {element.name}")
        for line, words in texts[at : at + element.count]:
            values, place = _numbers(line, words), 0
            row = []
            for _, _, counted in element.properties:
                length = 1
                if counted:
                    length, place = _whole(line, values[place]) if place < len(values) else 0, place + 1
                row.append(values[place : place + length])
                place += length
            if place != len(values):
                raise ValueError(f"{line}: expected {place} numbers of {element.name}, got {len(values)}")
            rows.append((line, row))
        tables.append(rows)
        at += element.count
    return tables


def _binary_tables(path: Path, raw: bytes, elements: list[_Element]) -> list[Rows]:
    tables, at = [], 0

    def take(kind: str, count: int, what: str) -> list[float]:
        nonlocal at
        size = np.dtype(PLY_TYPES[kind]).itemsize * count
        if count < 0 or at + size > len(raw):
            raise ValueError(f"{path}: ends inside {what}")
        values: list[float] = np.frombuffer(raw, PLY_TYPES[kind], count, at).tolist()
        at += size
        return values

    for element in elements:
        rows: Rows = []
        for k in range(element.count):
            what = f"{element.name} {k + 1}"
            row = [
                take(kind, int(take(counted, 1, what)[0]) if counted else 1, what)
                for _, kind, counted in element.properties
            ]
            rows.append((f"{path}: {what}", row))
        tables.append(rows)
    return tables


def _whole(line: str, value: float) -> int:
    if not math.isfinite(value) or value != int(value):
        raise ValueError(f"{line}: expected a whole number, got {value:g}")
    return int(value)


def _numbers(line: str, words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        raise ValueError(f"{line}: expected numbers, got {' '.join(words)[:60]!r}") from None


def _index(line: str, word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"{line}: expected the number of a vertex, got {word!r}") from None
