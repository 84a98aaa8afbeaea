"""Triangle meshes: STL (text and binary), PLY and OBJ, read by trimesh (extra `mesh`)."""

from __future__ import annotations

import io
import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import InputError, MalformedInputError
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.surfaces.mesh import TriangleMesh
from cmm_align.surfaces.protocol import Array

Index = NDArray[np.int64]

_BINARY_HEAD: Final = 84
_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_LARGEST: Final = 1e9
_TEXT_STL: Final = re.compile(rb"\s*solid\b[^\n\r]*[\r\n]+\s*(facet\s+normal|endsolid)", re.I)
_OBJ: Final = re.compile(rb"^v(?:[ \t]+[-+.\deE]+){3,}[ \t]*\r?$", re.M)
_OBJ_WORDS: Final = (b"v", b"vn", b"vt", b"vp", b"f", b"o", b"g", b"s", b"l", b"mtllib", b"usemtl", b"#", b"")
_PLY_FACES: Final = re.compile(rb"^element\s+face\s+(\d+)", re.M)


def recognises(head: bytes) -> bool:
    """Return whether the first bytes are those of an STL, PLY or OBJ file."""
    return bool(_kind(head))


def read(source: Source, units: str | None = None) -> TriangleMesh:
    """Return the mesh of a file.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length; mm by default, none of these formats states one.

    Raises
    ------
    InputError
        If trimesh is not installed.
    MalformedInputError
        If the file is cut off or damaged, or holds no triangles.

    Notes
    -----
    STL holds single precision: 8 to 15 nm at 200 mm.
    """
    kind = _kind(source.head)
    scale = scale_to_mm("", units, source.where)
    if kind == "stl" and not _TEXT_STL.match(source.raw):
        points, facets = _binary_stl(source)
    else:
        points, facets = _by_trimesh(source, kind)
    return TriangleMesh.of(points * scale, facets, source.where)


def _kind(head: bytes) -> str:
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if _TEXT_STL.match(head) or _is_binary_stl(head):
        return "stl"
    words = {line.split(None, 1)[0] if line.strip() else b"" for line in head.splitlines()[:-1][:200]}
    return "obj" if _OBJ.search(head) and words <= set(_OBJ_WORDS) else ""


def _is_binary_stl(head: bytes) -> bool:
    """Return whether the numbers after the head are facets: finite, with normals of length 1 or 0."""
    count = int.from_bytes(head[80:_BINARY_HEAD], "little")
    there = (len(head) - _BINARY_HEAD) // _FACET.itemsize
    if there < 1 or count < 1:
        return False
    facets = np.frombuffer(head, _FACET, min(count, there), _BINARY_HEAD)
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(facets["normal"].astype(np.float64), axis=1)
        small = np.abs(facets["corners"]) < _LARGEST
    return bool(small.all() and ((np.abs(length - 1.0) < 0.01) | (length == 0.0)).all())


def _binary_stl(source: Source) -> tuple[Array, Index]:
    """Read a binary STL: its numbers are its bytes, and its length says whether it is whole."""
    count = int.from_bytes(source.raw[80:_BINARY_HEAD], "little")
    there = (len(source.raw) - _BINARY_HEAD) // _FACET.itemsize
    if there < count:
        raise MalformedInputError(
            f"the file is incomplete ({there} of {count} facets)", where=source.where, remedy="make it again"
        )
    corners = np.frombuffer(source.raw, _FACET, count, _BINARY_HEAD)["corners"]
    return corners.reshape(-1, 3).astype(np.float64), np.arange(3 * count).reshape(-1, 3)


def _by_trimesh(source: Source, kind: str) -> tuple[Array, Index]:
    """Read any other mesh; what the library passes over in silence is counted here."""
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"reading {kind.upper()} files needs the library trimesh",
            where=source.where,
            remedy="pip install 'cmm-align[mesh]'",
        ) from None
    try:
        mesh = trimesh.load_mesh(io.BytesIO(source.raw), file_type=kind, process=False)
        points = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        facets = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as problem:  # a parser of foreign bytes may fail in any way
        raise MalformedInputError(
            f"a damaged {kind.upper()} file ({type(problem).__name__}: {problem})",
            where=source.where,
            remedy="make it again",
        ) from None
    _refuse_incomplete(source, kind, len(facets))
    return points, facets


def _refuse_incomplete(source: Source, kind: str, n_facets: int) -> None:
    """Compare the facets read with those the file announces."""
    announced = 0
    if kind == "stl":
        announced = len(re.findall(rb"^\s*facet\b", source.raw, re.M | re.I))
        if not re.search(rb"^\s*endsolid\b", source.raw[-4096:], re.M | re.I):
            raise MalformedInputError(
                f"the file is incomplete (its end is missing after {n_facets} facets)",
                where=source.where,
                expected="endsolid",
                remedy="make it again",
            )
    elif kind == "ply":
        found = _PLY_FACES.search(source.raw[: source.raw.find(b"end_header")])
        announced = int(found[1]) if found else 0
    if n_facets == 0:
        raise MalformedInputError(
            f"a {kind.upper()} file without triangles", where=source.where, expected="a triangle mesh"
        )
    if n_facets < announced:
        raise MalformedInputError(
            f"the file is incomplete ({n_facets} of {announced} facets)",
            where=source.where,
            remedy="make it again",
        )
