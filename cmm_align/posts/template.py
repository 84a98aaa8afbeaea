"""A text format described by a TOML file: a line with placeholders, a header, a footer.

```toml
schema = "cmm-align/post/1"
suffix = ".txt"                 # of the file that is written
line = "X{x} Y{y} Z{z}"         # x y z contact, i j k normal, cx cy cz tool centre, n number of the line
order = "rows"                  # or raster-x, raster-y, spiral-inwards, spiral-outwards
header = ""                     # with {name} {points} {units} {wheel_radius} {wheel_tip_radius} {feed} ...
footer = ""                     # the same
units = "mm"                    # of lengths
decimals = 6                    # of lengths; at least what rounding to 1 nm takes
normal_decimals = 9
decimal_sign = "."              # or ","
plus_sign = false               # before numbers that are not below zero
line_ending = "lf"              # or crlf
first_number = 1
```

Only `schema` and `line` must be there. A file is read back by the same description: each line must have the
form of `line`, number by number.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.fixed_decimals import Field, Piece, lines_of
from cmm_align.formats.source import load
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.posts.commanded import CommandedPoints, points_and_normals
from cmm_align.posts.contacts import contacts
from cmm_align.posts.job import ExportJob
from cmm_align.posts.limits import check_lines
from cmm_align.posts.numbers import table_of
from cmm_align.posts.rounding import check_decimals, least_decimals, least_normal_decimals, rounding_mm
from cmm_align.posts.tool_path import raster, spiral
from cmm_align.surfaces.protocol import Array
from cmm_align.toml_table import check_keys, did_you_mean
from cmm_align.units import mm_per

SCHEMA: Final = "cmm-align/post/1"
OF_A_LINE: Final = ("x", "y", "z", "i", "j", "k", "cx", "cy", "cz", "n")
OF_THE_FILE: Final = (
    "name",
    "points",
    "units",
    "wheel_radius",
    "wheel_tip_radius",
    "feed",
    "safe_height",
    "frame",
)
ORDERS: Final = ("rows", "raster-x", "raster-y", "spiral-inwards", "spiral-outwards")

_ENDINGS: Final = {"lf": "\n", "crlf": "\r\n"}
_PLACEHOLDER: Final = re.compile(r"\{([^{}]*)\}")
_NORMAL: Final = ("i", "j", "k")
_TAIL: Final = 4096
_TAKEN: Final = {".h5", ".hdf5", ".png", ".svg", ".pdf", ".html", ".mat"}


@dataclass(frozen=True, slots=True)
class Template:
    """A text format, as its file describes it."""

    schema: str
    line: str
    suffix: str = ".txt"
    order: str = "rows"
    header: str = ""
    footer: str = ""
    units: str = "mm"
    decimals: int = 0
    normal_decimals: int = 0
    decimal_sign: str = "."
    plus_sign: bool = False
    line_ending: str = "lf"
    first_number: int = 1
    where: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Return the placeholders of the line, in their order."""
        return tuple(_PLACEHOLDER.findall(self.line))


def read_template(path: str) -> Template:
    """Return the format that a file describes.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MalformedInputError
        If a key or placeholder is not known, or a value is none that it may have.
    UsageError
        If there are fewer decimals than rounding to 1 nm takes.
    """
    source = load(path)
    where = source.where
    try:
        table = tomllib.loads(decoded(source.raw, where))
    except tomllib.TOMLDecodeError as error:
        raise MalformedInputError(f"not valid TOML: {error}", where=where) from None
    return template_of(table, where)


def template_of(table: dict[str, Any], where: str) -> Template:
    """Return the format that a table describes, its defaults filled in; errors as `read_template`."""
    known = {f.name: f.type for f in fields(Template) if f.name != "where"}
    check_keys(table, known, where=where)
    for key, value in table.items():
        wanted = {"str": str, "int": int, "bool": bool}[str(known[key])]
        if type(value) is not wanted:
            raise MalformedInputError(f"{key} = {value!r}", where=where, expected=f"a {wanted.__name__}")
    if table.get("schema") != SCHEMA or not table.get("line"):
        raise MalformedInputError(
            "no description of a text format", where=where, expected=f'schema = "{SCHEMA}" and a line'
        )
    made = Template(**table, where=where)
    choices = {"order": ORDERS, "decimal_sign": (".", ","), "line_ending": tuple(_ENDINGS)}
    for key, words in choices.items():
        if getattr(made, key) not in words:
            raise MalformedInputError(
                f"{key} = {getattr(made, key)!r}", where=where, expected=" or ".join(words)
            )
    if not re.fullmatch(r"\.[A-Za-z0-9]{1,8}", made.suffix) or made.suffix.lower() in _TAKEN:
        raise MalformedInputError(f"suffix = {made.suffix!r}", where=where, expected='one of text, as ".txt"')
    _check_text(made, where)
    unit_mm = mm_per(made.units, where=f"{where}:units")
    least = least_decimals(unit_mm)
    return replace(
        made,
        decimals=check_decimals(made.decimals or least, least, f"lengths in {made.units}", where),
        normal_decimals=made.normal_decimals or least_normal_decimals(None),
    )


def _check_text(made: Template, where: str) -> None:
    """Refuse placeholders that are not known, loose braces, and lines that cannot be read back."""
    for key, known in (("line", OF_A_LINE), ("header", OF_THE_FILE), ("footer", OF_THE_FILE)):
        text = getattr(made, key)
        for name in _PLACEHOLDER.findall(text):
            if name not in known:
                raise MalformedInputError(
                    f"unknown placeholder {{{name}}} in {key}",
                    where=where,
                    expected=f"one of {', '.join(known)}",
                    remedy=did_you_mean(name, known),
                )
        if set(_PLACEHOLDER.sub("", text)) & {"{", "}", "\0"} or not text.isascii():
            raise MalformedInputError(f"a loose brace or a character that is not ASCII in {key}", where=where)
    names = made.names
    complete = {"x", "y", "z"} <= set(names) or {"cx", "cy", "cz"} <= set(names)
    if not complete or len(set(names)) < len(names) or "\n" in made.line:
        raise MalformedInputError(
            f"line = {made.line!r}",
            where=where,
            expected="one line with {x}, {y}, {z} or {cx}, {cy}, {cz}, each placeholder once",
        )
    between = _PLACEHOLDER.split(made.line)[2:-1:2]
    if any(not text or text[0] in "0123456789" + made.decimal_sign for text in between):
        raise MalformedInputError(
            f"line = {made.line!r}", where=where, expected="something between the numbers that is no digit"
        )


def blocks(job: ExportJob, template: Template) -> Iterator[bytes]:
    """Give the file of a job in a format.

    Raises
    ------
    UsageError
        If the format wants tool centres and there is no wheel, the decimals of the normals are too few for
        the wheel, or the control takes fewer lines.
    """
    names, end = template.names, _ENDINGS[template.line_ending]
    if set(names) & set(_NORMAL):
        least = least_normal_decimals(job.wheel)
        check_decimals(template.normal_decimals, least, "normals", template.where)
    points, normals = _ordered(job, template.order)
    table: dict[str, Array] = dict(zip(("x", "y", "z"), points.T, strict=True))
    table |= dict(zip(_NORMAL, normals.T, strict=True))
    if set(names) & {"cx", "cy", "cz"}:
        centres = points + centre_from_contact(job.known_wheel(f"the format {template.where}"), normals)
        table |= dict(zip(("cx", "cy", "cz"), centres.T, strict=True))
    unit_mm = mm_per(template.units)
    check_lines(len(points) + template.header.count("\n") + template.footer.count("\n"), job.config)
    columns, pieces = [], list[Piece]()
    parts = _PLACEHOLDER.split(template.line)
    for k, part in enumerate(parts):
        if k % 2 == 0:
            pieces.append(part.encode("ascii"))
            continue
        if part == "n":
            columns.append(np.arange(len(points), dtype=np.float64) + template.first_number)
        else:
            columns.append(table[part] if part in _NORMAL else table[part] / unit_mm)
        pieces.append(
            Field(
                len(columns) - 1,
                _decimals(template, part),
                template.plus_sign and part != "n",
                template.decimal_sign.encode("ascii"),
            )
        )
    pieces = [piece for piece in pieces if piece != b""]
    yield _around(template.header, job, template, len(points)).encode("ascii")
    yield from lines_of([*pieces, end.encode("ascii")], columns)
    yield _around(template.footer, job, template, len(points)).encode("ascii")


def _decimals(template: Template, name: str) -> int:
    if name == "n":
        return 0
    return template.normal_decimals if name in _NORMAL else template.decimals


def _ordered(job: ExportJob, order: str) -> tuple[Array, Array]:
    """Return contact points and normals in the order asked for, frame `part`."""
    kind, _, direction = order.partition("-")
    if kind == "rows":
        return points_and_normals(job.correction)
    if kind == "raster":
        path = raster(job.correction, replace(job.config, raster_along=direction), job.wheel)
    else:
        path = spiral(job.correction, replace(job.config, spiral_direction=direction), job.wheel)
    return path.points_mm, path.normals


def _around(text: str, job: ExportJob, template: Template, n: int) -> str:
    """Return header or footer with its values."""
    wheel = job.wheel
    unit_mm = mm_per(template.units)
    values = {
        "name": job.program_name(),
        "points": str(n),
        "units": template.units,
        "wheel_radius": "" if wheel is None else f"{wheel.radius_mm / unit_mm:.9g}",
        "wheel_tip_radius": "" if wheel is None else f"{wheel.tip_radius_mm / unit_mm:.9g}",
        "feed": f"{job.config.feed_mm_min / unit_mm:.9g}",
        "frame": job.frame,
        "safe_height": f"{job.config.safe_height_mm / unit_mm:.9g}",
    }
    return _ended(_PLACEHOLDER.sub(lambda found: values[found[1]], text), template)


def _ended(text: str, template: Template) -> str:
    """Return a text with the line ends of the format."""
    return text.replace("\r\n", "\n").replace("\n", _ENDINGS[template.line_ending])


def read(
    raw: bytes, where: str, template: Template, wheel: Wheel | None = None, outward: Array | None = None
) -> CommandedPoints:
    """Return what stands in a file of a format.

    Parameters
    ----------
    raw : bytes
    where : str
    template : Template
    wheel : Wheel, optional
        Needed where the format has tool centres and no contacts.
    outward : ndarray, shape (3,), optional
        A direction out of the material in frame `part`; needed for the same.

    Raises
    ------
    MalformedInputError
        If the file is cut off, or a line does not have the form of the description.
    """
    end = _ENDINGS[template.line_ending].encode("ascii")
    header, footer = (
        re.sub(rb"\\\{[^{}]*\}", rb"[^\\r\\n]*", re.escape(_ended(text, template)).encode("ascii"))
        for text in (template.header, template.footer)
    )
    last = re.compile(rb"(?<=" + re.escape(end) + rb")" + footer + rb"\Z")
    top, bottom = re.match(header, raw), last.search(raw, max(0, len(raw) - len(footer) - _TAIL))
    if top is None or bottom is None:
        raise MalformedInputError(
            "not a whole file of this format", where=where, expected="its header, its lines and its footer"
        )
    text, names = raw[top.end() : bottom.start()], template.names
    pattern = _pattern(template)
    literal = "".join(_PLACEHOLDER.split(template.line)[::2])
    for line in (text[: text.find(end)], text.rstrip(b"\r\n").rpartition(b"\n")[2]):
        if not re.fullmatch(pattern, line):
            raise MalformedInputError(f"{line[:60]!r}", where=where, expected=f"lines like {template.line}")
    of_numbers = set("0123456789+-.eE" + template.decimal_sign)
    if set(literal) & of_numbers:
        found = [re.fullmatch(pattern, line) for line in text.removesuffix(end).split(end)]
        text = b"\n".join(b" ".join(one.groups()) if one else b"?" for one in found)
    if template.decimal_sign == ",":
        text = text.replace(b",", b".")
    letters = bytes(sorted(set("".join(set(literal) - of_numbers - {" "}).encode("ascii"))))
    columns = dict(zip(names, table_of(text, len(names), where, letters).T, strict=True))
    return _points(columns, template, where, wheel, outward)


def _pattern(template: Template) -> bytes:
    """Return what a line of a format looks like."""
    parts = _PLACEHOLDER.split(template.line)
    sign = re.escape(template.decimal_sign)
    number = rf"([+-]?\d+(?:{sign}\d+)?)"
    return "".join(number if k % 2 else re.escape(part) for k, part in enumerate(parts)).encode("ascii")


def _points(
    columns: dict[str, Array], template: Template, where: str, wheel: Wheel | None, outward: Array | None
) -> CommandedPoints:
    """Return the points of the columns of a file."""
    unit_mm = mm_per(template.units)

    def triple(names: tuple[str, str, str], scale: float) -> Array | None:
        if not set(names) <= set(columns):
            return None
        return np.stack([columns[name] for name in names], axis=1) * scale

    points, normals = triple(("x", "y", "z"), unit_mm), triple(("i", "j", "k"), 1.0)
    centres = triple(("cx", "cy", "cz"), unit_mm)
    accuracy = rounding_mm(template.decimals, unit_mm)
    if points is None and centres is not None:
        if wheel is None or outward is None:
            raise MalformedInputError(
                "tool centres without contacts", where=where, expected="the wheel and a direction outwards"
            )
        found = contacts(centres, np.array([0]), wheel, outward)
        points, normals, accuracy = found.points_mm, found.normals, accuracy + found.error_mm
    if points is None:
        raise MalformedInputError("neither contacts nor tool centres", where=where)
    return CommandedPoints(points, normals, centres, "part", accuracy)
