"""CAD faces: STEP and IGES through Open CASCADE (extra `cad`), one of them as an exact NURBS patch."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any, Final

from cmm_align.errors import InputError, MalformedInputError, UsageError
from cmm_align.formats.cad_patch import Face, patch_of
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.surfaces.nurbs import NurbsSurface

_STEP: Final = b"ISO-10303-21"
_IGES_LINE: Final = 80
_MOST_LISTED: Final = 20
_STEP_UNITS: Final = (
    (rb"CONVERSION_BASED_UNIT\s*\(\s*'INCH'", "inch"),
    (rb"SI_UNIT\s*\(\s*\.MILLI\.\s*,\s*\.METRE\.", "mm"),
    (rb"SI_UNIT\s*\(\s*\.MICRO\.\s*,\s*\.METRE\.", "um"),
    (rb"SI_UNIT\s*\(\s*\.CENTI\.\s*,\s*\.METRE\.", "cm"),
    (rb"SI_UNIT\s*\(\s*\$\s*,\s*\.METRE\.", "m"),
)


def recognises(head: bytes) -> bool:
    """Return whether the first bytes are those of a STEP or IGES file."""
    return _is_step(head) or _is_iges(head)


def _is_step(head: bytes) -> bool:
    return head.lstrip()[:64].startswith(_STEP)


def _is_iges(head: bytes) -> bool:
    """Return whether the first line is one of the start section: S in column 73, then its number."""
    line = head.split(b"\n", 1)[0].rstrip(b"\r")
    return len(line) == _IGES_LINE and line[72:73] == b"S" and line[73:].strip().isdigit()


def read(source: Source, units: str | None = None, face: int | None = None) -> NurbsSurface:
    """Return one face of a STEP or IGES file as a trimmed patch, frame `part`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit the user gave; must not differ from the one in the file.
    face : int, optional
        Number of the face, from 1; needed where the file holds several.

    Raises
    ------
    InputError
        If Open CASCADE is not installed, or the file holds several faces and none was chosen.
    UsageError
        If there is no face of that number.
    MalformedInputError
        If the file is damaged or holds no face.
    UnitsError
        If the file states another unit than `units`.
    """
    try:
        import OCP.Message
    except ImportError:
        raise InputError(
            "reading STEP and IGES files needs the library Open CASCADE",
            where=source.where,
            remedy="pip install 'cmm-align[cad]'",
        ) from None
    OCP.Message.Message.DefaultMessenger_s().ChangePrinters().Clear()  # it would write to stdout
    shape, stated = _loaded(source)
    if units:
        scale_to_mm(stated, units, source.where)
    faces = _faces(shape)
    if not faces:
        raise MalformedInputError("the file holds no face", where=source.where, expected="a surface")
    if face is None and len(faces) > 1:
        raise InputError(
            f"the file holds {len(faces)} faces: {_listed(faces)}",
            where=source.where,
            remedy="choose the measured one with --face N",
        )
    number = 1 if face is None else face
    if not 1 <= number <= len(faces):
        raise UsageError(
            f"--face {number}: there is no such face in {source.where}",
            expected=f"1 to {len(faces)}: {_listed(faces)}",
        )
    return patch_of(faces[number - 1], f"{source.where}: face {number}")


def _listed(faces: list[Face]) -> str:
    """Name the faces, the largest first where there are many."""
    named = [(k, f) for k, f in enumerate(faces, 1)]
    if len(named) > _MOST_LISTED:
        named = sorted(named, key=lambda pair: -pair[1].area_mm2)[:_MOST_LISTED]
    text = ", ".join(f"{k} {f.kind} {f.area_mm2:.4g} mm^2" for k, f in named)
    return text + (", ..." if len(faces) > len(named) else "")


def _loaded(source: Source) -> tuple[Any, str]:
    """Return the shape of a file, in mm, and the unit it states; the library reads from the disk only."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader

    step = _is_step(source.head)
    reader: Any = STEPControl_Reader() if step else IGESControl_Reader()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "shape.step" if step else "shape.igs")
        path.write_bytes(source.raw)
        good = reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
        good = good and reader.TransferRoots() > 0
    shape = reader.OneShape() if good else None
    if shape is None or shape.IsNull():
        raise MalformedInputError(
            f"a damaged {'STEP' if step else 'IGES'} file, or one without shapes",
            where=source.where,
            remedy="export it again",
        )
    return shape, _step_unit(source.raw) if step else _iges_unit(reader)


def _step_unit(raw: bytes) -> str:
    for pattern, unit in _STEP_UNITS:
        if re.search(pattern, raw):
            return unit
    return ""


def _iges_unit(reader: Any) -> str:
    name = reader.IGESModel().GlobalSection().UnitName()
    text = name.ToCString().lower() if name is not None else ""
    return text if text in {"mm", "cm", "m", "um", "in", "inch"} else ""


def _faces(shape: Any) -> list[Face]:
    """Return all faces in the order of the file."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    found, walk = [], TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        face = TopoDS.Face(walk.Current())
        properties = GProp_GProps()
        BRepGProp.SurfaceProperties_s(face, properties)
        kind = BRepAdaptor_Surface(face).GetType().name.removeprefix("GeomAbs_")
        found.append(Face(face, _in_words(kind), abs(float(properties.Mass()))))
        walk.Next()
    return found


def _in_words(kind: str) -> str:
    """Turn ``SurfaceOfRevolution`` into ``surface of revolution``."""
    kind = kind.replace("BSpline", "Bspline")
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind).lower().replace("bspline", "B-spline")
