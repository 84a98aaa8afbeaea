"""A saddle with known heights, and the files in which CMM software writes it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GRID = [(x, y) for y in (-9.0, 4.0, 12.5) for x in (-10.0, -3.5, 8.0)]
NORMALS = [("-0.07216", "0.01000", "0.99734"), ("0.02000", "-0.03000", "0.99935"), ("0", "0.6", "-0.8")] * 3


def printed(decimals: int = 5, unit_mm: float = 1.0) -> list[tuple[str, str, str]]:
    """Return x, y, z of the saddle z = 0.004 x^2 - 0.002 y^2 + 1e-4 x^2 y as a machine prints them."""
    heights = [(x, y, 0.004 * x**2 - 0.002 * y**2 + 1e-4 * x**2 * y) for x, y in GRID]
    return [tuple(f"{v / unit_mm:.{decimals}f}" for v in point) for point in heights]  # type: ignore[misc]


TEXT = printed()
TRUTH = np.array(TEXT, dtype=np.float64)
"""What has been printed, to the last digit."""

INCH_TEXT = printed(7, 25.4)
INCH_TRUTH = np.array(INCH_TEXT, dtype=np.float64) * 25.4


def geopak(points: Sequence[Sequence[str]] = TEXT, plane: str = "XY(Z)", unit: str = "MM") -> str:
    """Points and directed points in turn, in the column order of the plane."""
    order = {"XY(Z)": (0, 1, 2), "YZ(X)": (1, 2, 0), "ZX(Y)": (2, 0, 1)}[plane]
    lines = ["#00:GEOPAK-WIN Scanning", "#02:SADDLE", f"#04:{plane}", "#05:Opn", f"#06:{unit}"]
    for k, (point, normal) in enumerate(zip(points, NORMALS, strict=True)):
        fields = [point[a] for a in order] + ([normal[a] for a in order] if k % 2 else [])
        lines.append(f"#{'12' if k % 2 else '03'}: {' '.join(fields)}")
    return "\r\n".join(lines) + "\r\n"


def vda(word: str = "PSET", points: Sequence[Sequence[str]] = TEXT, numbered: bool = True) -> str:
    """One statement for all points, or one each for POINT, in records of 80 columns."""
    rows = [(*p, *n) if word == "MDI" else p for p, n in zip(points, NORMALS, strict=True)]
    records = ["DEMO    = HEADER / 2", "A NAME = POINT / 9, 9, 9 that is free text", "$ SECOND = LINE"]
    records.append("$$ a comment = POINT / 1, 2, 3")
    if word == "POINT":
        records += [f"P{k}   = POINT / {', '.join(row)}" for k, row in enumerate(rows, 7)]
    else:
        records += [f"SCAN = {word} / {len(rows)},", *(", ".join(row) + "," for row in rows)]
        records[-1] = records[-1].removesuffix(",")
    records.append("DEMO    = END")
    if numbered:
        records = [f"{record:<72}{k:08d}" for k, record in enumerate(records, 1)]
    return "\r\n".join(records) + "\r\n"


def dmis(points: Sequence[Sequence[str]] = TEXT, unit: str = "MM") -> str:
    """Nominal and actual points in turn, statements over two lines, comments, and the end."""
    lines = ["FILNAM/'saddle', 05.2", f"UNITS/{unit},ANGDEC", "$$ FA(P9)=FEAT/POINT,CART,1,2,3"]
    for k, (point, normal) in enumerate(zip(points, NORMALS, strict=True), 7):
        lines += [f"F(P{k})=FEAT/POINT,CART,99,99,99,0,0,1", f"PTMEAS/CART,{k},0,0,0,0,1"]
        lines += [f"FA(P{k})=FEAT/POINT,CART,{','.join(point)},$", ",".join(normal)]
    lines += ["FA(PL1)=FEAT/PLANE,CART,0,0,0,0,0,1", "ENDFIL"]
    return "\r\n".join(lines) + "\r\n"


def pc_dmis(points: Sequence[Sequence[str]] = TEXT) -> str:
    """Point features, and one plane whose hits are the last three points."""
    lines = ["PART NAME  : SADDLE", "STARTUP    =ALIGNMENT/START,RECALL:USE_PART_SETUP,LIST=YES"]
    lines += ["            ALIGNMENT/END", "            COMMENT/REPT,a comment"]
    for k, (point, normal) in enumerate(zip(points[:-3], NORMALS, strict=False), 1):
        place, normals = ",".join(point), ",".join(normal)
        lines += [f"PNT{k}       =FEAT/POINT,CARTESIAN", "            THEO/<99,99,99>,<0,0,1>"]
        lines += [f"            ACTL/<{place}>,<{normals}>", "            MEAS/POINT,1"]
        lines += [f"              HIT/BASIC,NORMAL,<99,99,99>,<0,0,1>,<{place}>,USE THEO=YES"]
        lines += ["            ENDMEAS/"]
    lines += ["PLN1       =FEAT/PLANE,CARTESIAN,OUTLINE,NO", "            THEO/<9,9,9>,<0,0,1>"]
    lines += ["            ACTL/<8,8,8>,<0,0,1>", "            MEAS/PLANE,3"]
    lines += [f"              HIT/BASIC,<9,9,9>,<0,0,1>,<{','.join(point)}>" for point in points[-3:]]
    lines += ["            ENDMEAS/"]
    return "\r\n".join(lines) + "\r\n"


CALYPSO_NAMES = [
    "planid",
    "partnb",
    "id",
    "type",
    "idsymbol",
    "x",
    "y",
    "z",
    "x_nom",
    "y_nom",
    "z_nom",
    "nx",
    "ny",
    "nz",
    "unit",
    "group1",
    "group2",
]


def calypso(
    points: Sequence[Sequence[str]] = TEXT, unit: str = "mm", names: Sequence[str] = CALYPSO_NAMES
) -> str:
    """Rows that are shorter than the first line, which ends with a tab; a plane among the points."""
    lines = ["\t".join(names) + "\t"]
    for k, (point, normal) in enumerate(zip(points, NORMALS, strict=True), 7):
        cells = dict(zip("xyz", point, strict=True)) | dict(zip(["nx", "ny", "nz"], normal, strict=True))
        cells |= {"planid": "demo", "id": f"P{k}", "idsymbol": "SpacePoint", "unit": unit, "x_nom": "99"}
        row = [cells.get(name, "") for name in names]
        lines.append("\t".join(row).rstrip("\t"))
    plane = {
        "planid": "demo",
        "id": "Plane1",
        "idsymbol": "Plane",
        "x": "0",
        "y": "0",
        "z": "0",
        "unit": unit,
    }
    lines.append("\t".join(plane.get(name, "") for name in names))
    return "\r\n".join([*lines, "END"]) + "\r\n"


TRACKER_NAMES = [
    "Enabled",
    "Feature",
    "ID ",
    "x        ",
    "y       ",
    "z  ",
    "i",
    "j",
    "k",
    "Device Position  ",
]
TRACKER_NAMES += ["Probe", "Device Name"]


def tracker(points: Sequence[Sequence[str]], directions: bool = False) -> str:
    """A table padded with blanks; the second point is not enabled."""
    lines = ["\t".join(TRACKER_NAMES)]
    for k, (point, normal) in enumerate(zip(points, NORMALS, strict=False), 1):
        direction = normal if directions else (" ", " ", " ")
        flag = "Unchecked" if k == 2 else "Checked"
        fields = [flag, "M2_1   ", f"{k}  ", *(f"{v:<12}" for v in point), *direction]
        lines.append("\t".join([*fields, "Device Position 1", "38.1 ", "V1"]))
    return "\r\n".join(lines) + "\r\n"


def iges(
    entities: Sequence[tuple[int, int, str]],
    unit: str = "2,2HMM",
    scale: str = "1.",
    matrix: int = 0,
) -> str:
    """A whole file of entities: number, form, and parameters, broken at commas where they are long."""
    records = f"1H,,1H;,4Hpart,8Hpart.igs,3Hcmm,1H1,32,38,6,308,15,4Hpart,{scale},{unit},1,0.01,"
    records += "15H20261122.000000,1E-6,100.,2Hme,2Hus,11,0,15H20261122.000000;"
    lines = [f"{'a saddle':<72}S{1:7d}"]
    globals_ = [records[k : k + 72] for k in range(0, len(records), 72)]
    lines += [f"{text:<72}G{k:7d}" for k, text in enumerate(globals_, 1)]
    directory: list[str] = []
    parameters: list[str] = []
    for n, (kind, form, text) in enumerate(entities):
        pieces = [""]
        for word in text.replace(",", ",\0").split("\0"):
            if len(pieces[-1]) + len(word) > 60:
                pieces.append("")
            pieces[-1] += word
        first = [kind, len(parameters) + 1, 0, 0, 0, 0, matrix, 0, "00000000"]
        second = [kind, 0, 0, len(pieces), form, "", "", "", 0]
        directory += ["".join(f"{v:>8}" for v in fields) for fields in (first, second)]
        parameters += [f"{piece:<64}{2 * n + 1:8d}" for piece in pieces]
    lines += [f"{text}D{k:7d}" for k, text in enumerate(directory, 1)]
    lines += [f"{text}P{k:7d}" for k, text in enumerate(parameters, 1)]
    counts = f"S{1:7d}G{len(globals_):7d}D{len(directory):7d}P{len(parameters):7d}"
    return "\r\n".join([*lines, f"{counts:<72}T{1:7d}"]) + "\r\n"


POINT_ENTITIES = [(116, 0, f"116,{','.join(point)},0;") for point in TEXT]
