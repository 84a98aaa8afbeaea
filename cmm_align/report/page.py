"""The report of a map as one HTML page: nothing to load beside it, on paper one sheet of A4.

Text that comes from users (names, paths, settings) is escaped by the template, and in the data of the map by
JSON with ``<``, ``>`` and ``&`` as escapes. A content security policy in the page allows its own script by
checksum, pictures as data, and nothing else: not even a name that got through could load or run anything.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from cmm_align import __version__
from cmm_align.model import DeviationMap
from cmm_align.provenance import InputFile, Step
from cmm_align.report.field import unknown_inside
from cmm_align.report.instruction import Instruction
from cmm_align.report.page_map import map_data, thinning
from cmm_align.report.page_section import shown
from cmm_align.report.page_sections import headline, sections
from cmm_align.report.summary import keeps, verdict_of

if TYPE_CHECKING:
    from jinja2 import Environment


MOST_BYTES: Final = 2_800_000
"""Of map and pictures together, as they stand in the page: it stays under 3 MB."""

_PNG: Final = b"\x89PNG"
_PATH: Final = re.compile(r' d="[^"]*"')
_LONG_NUMBER: Final = re.compile(r"-?\d+\.\d{3,}")


class PagePicture(NamedTuple):
    """A picture for the page: what it shows, and the bytes of its file, SVG or PNG."""

    title: str
    data: bytes


@dataclass(frozen=True, slots=True)
class PageStep:
    """A step of the provenance as the page shows it."""

    command: str
    version: str
    time: str
    inputs: tuple[InputFile, ...]
    settings: tuple[tuple[str, str], ...]


def write_page(
    deviation_map: DeviationMap,
    path: Path | str,
    *,
    title: str,
    source: str,
    probe: str,
    advice: Instruction,
    steps: Sequence[Step] = (),
    warnings: Sequence[str] = (),
    pictures: Sequence[PagePicture] = (),
) -> None:
    """Write the report of a map as HTML.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
    title : str
        Name of the part; shown as it is, whatever is in it.
    source : str
        Name of the file behind the map.
    probe : str
        Which ball, on which side of the nominal.
    advice : Instruction
        What to do next.
    steps : sequence of Step
        All that led to the map, oldest first.
    warnings : sequence of str
    pictures : sequence of PagePicture
        Shown below the tables as long as there is room for them; the page names those that are left out.
    """
    m = deviation_map
    verdict, reasons = verdict_of(m)
    nominal = m.alignment.nominal
    script, style, paper = (_template_text(name) for name in ("page.js", "page.css", "paper.css"))
    from markupsafe import Markup

    data = map_data(m)
    shown_pictures, left_out = _chosen(pictures, MOST_BYTES - len(data["deviation"]) - len(data["u"]))
    text = (
        _environment()
        .get_template("page.html")
        .render(
            title=title,
            source=source,
            time=_time(steps[-1].time_utc) if steps else "",
            version=__version__,
            verdict=verdict,
            reasons=[(shown(reason), keeps(reason)) for reason in reasons],
            headline=headline(m),
            advice=advice,
            warnings=[shown(text) for text in warnings],
            holes=unknown_inside(nominal, m.x_mm, m.y_mm, m.deviation_mm) > 0,
            report_region=m.alignment.report.report_region,
            every=thinning(m.deviation_mm.size),
            sections=sections(m, probe),
            pictures=shown_pictures,
            left_out=left_out,
            steps=[page_step(step) for step in steps],
            map_data=data,
            script=Markup(script),
            style=Markup(style),
            paper_style=Markup(paper),
            script_hash=_hash(script),
        )
    )
    Path(path).write_bytes(text.encode("utf-8", "replace"))


def _chosen(pictures: Sequence[PagePicture], room: int) -> tuple[list[dict[str, str]], list[str]]:
    """Return the pictures that there is room for, small ones first in line, and the titles of the others."""
    uris = [_data_uri(picture.data) for picture in pictures]
    chosen = set()
    for k in sorted(range(len(uris)), key=lambda k: len(uris[k])):
        room -= len(uris[k])
        if room >= 0:
            chosen.add(k)
    shown_ones = [{"title": pictures[k].title, "uri": uris[k]} for k in sorted(chosen)]
    return shown_ones, [picture.title for k, picture in enumerate(pictures) if k not in chosen]


def lean(svg: str) -> str:
    """Return an SVG with its paths to two decimals, a hundredth of a point: no eye can tell."""
    return _PATH.sub(lambda path: _LONG_NUMBER.sub(lambda n: f"{float(n[0]):.2f}", path[0]), svg)


def page_step(step: Step) -> PageStep:
    """Return a step with its settings as names with dots between and values as JSON writes them."""
    return PageStep(
        step.command, step.version, _time(step.time_utc), step.inputs, tuple(_flat(step.parameters))
    )


def _flat(table: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, str]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            told = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
            yield f"{before}{name}", told or "–"


def _time(time_utc: str) -> str:
    """Return a time of the provenance as people read it, still UTC."""
    return time_utc.replace("T", " ").removesuffix("Z") + (" UTC" if time_utc.endswith("Z") else "")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("cmm_align.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _template_text(name: str) -> str:
    """Return a file of the page as it will stand in it, with line ends of one kind: its checksum counts."""
    text = resources.files("cmm_align.report").joinpath("templates", name).read_text(encoding="utf-8")
    return text.replace("\r\n", "\n")


def _hash(script: str) -> str:
    """Return the checksum of a script as a content security policy takes it."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode('utf-8')).digest()).decode('ascii')}"


def _data_uri(picture: bytes) -> str:
    """Return a picture as the address that holds it."""
    if picture.startswith(_PNG):
        kind = "png"
    else:
        kind, picture = "svg+xml", lean(picture.decode("utf-8")).encode("utf-8")
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"
