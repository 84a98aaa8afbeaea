"""The papers beside a map: the page that people look at and sign, and the card of the operator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final
from warnings import catch_warnings, simplefilter

from cmm_align.cli.drawing import attempt, named, not_drawn
from cmm_align.cli.job import beside, typed
from cmm_align.errors import GeometryError
from cmm_align.report.pictures import PICTURES, draw

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap
    from cmm_align.provenance import Step
    from cmm_align.report.page import PagePicture
    from cmm_align.report.wishes import Wishes


_DOTS: Final = {"bands", "outliers"}
"""Pictures that are mostly colours of a map: as SVG they would be larger."""


@dataclass(frozen=True, slots=True)
class Papers:
    """Which papers to write.

    Attributes
    ----------
    report : bool
        The page, as HTML.
    card : bool
        The operator card, as PDF.
    pass_number : int or None
        Which grind was measured; nothing in a map tells it.
    """

    report: bool = False
    card: bool = False
    pass_number: int | None = None

    def paths(self, output: Path) -> list[Path]:
        """Return where the papers go: beside the map, with its stem."""
        both = ((self.report, _page_path(output)), (self.card, _card_path(output)))
        return [path for wanted, path in both if wanted]

    def write(
        self,
        deviation_map: DeviationMap,
        output: Path,
        wishes: Wishes,
        steps: Sequence[Step],
        warnings: Sequence[str],
        *,
        overwrite: bool,
    ) -> tuple[list[Path], list[str]]:
        """Write them; return those that were written, and a sentence for those that were not.

        Parameters
        ----------
        deviation_map : DeviationMap
        output : Path
            The map.
        wishes : Wishes
            What the pictures show; title and source of the papers.
        steps : sequence of Step
            All that led to the map.
        warnings : sequence of str
        overwrite : bool
            Whether papers that are there may be replaced.
        """
        from cmm_align.report.instruction import instruction

        advice = instruction(deviation_map, typed("cmm-align", "compensate", output.name))

        def page(path: Path) -> None:
            from cmm_align.cli.results import probe_row
            from cmm_align.report.page import write_page

            write_page(
                deviation_map,
                path,
                title=wishes.title,
                source=wishes.source,
                probe=probe_row(deviation_map.alignment.nominal)[1],
                advice=advice,
                steps=steps,
                warnings=warnings,
                pictures=_page_pictures(deviation_map, wishes),
            )

        def card(path: Path) -> None:
            from cmm_align.report.card import draw_card

            draw_card(
                deviation_map,
                path,
                title=wishes.title,
                advice=advice,
                pass_number=self.pass_number,
                date=steps[-1].time_utc.partition("T")[0] if steps else "",
            )

        written, faults = [], []
        for wanted, write, path in (
            (self.report, page, _page_path(output)),
            (self.card, card, _card_path(output)),
        ):
            fault = attempt(write, path, overwrite=overwrite) if wanted else ""
            if fault:
                faults.append(not_drawn([named(path)], fault))
            elif wanted:
                written.append(path)
        return written, faults


def _page_pictures(deviation_map: DeviationMap, wishes: Wishes) -> list[PagePicture]:
    """Return the pictures for the page; without map and relief, which its own map replaces."""
    from cmm_align.report.comparison_picture import draw_comparison
    from cmm_align.report.page import PagePicture

    found = deviation_map.root_causes
    left_out = {"map", "relief"} | (set() if deviation_map.alignment.report.n_outliers else {"outliers"})
    left_out |= set() if found is not None and found.causes else {"causes"}
    drawings: list[tuple[str, str, Callable[[Path], None]]] = [
        (
            picture.sentence,
            "png" if name in _DOTS else "svg",
            partial(draw, name, deviation_map, wishes=wishes),
        )
        for name, picture in PICTURES.items()
        if name not in left_out
    ]
    if deviation_map.comparison is not None:
        changes = partial(draw_comparison, deviation_map, title=wishes.title, source=wishes.source)
        drawings.append(("what changed since the earlier measurement", "png", changes))
    pictures = []
    with TemporaryDirectory() as folder, catch_warnings():
        simplefilter("ignore")  # a letter that the font has not is no reason to talk
        for title, kind, drawing in drawings:
            path = Path(folder) / f"picture.{kind}"
            try:
                drawing(path)
            except GeometryError:
                continue
            pictures.append(PagePicture(title, path.read_bytes()))
    return pictures


def _page_path(output: Path) -> Path:
    return output.with_suffix(".html")


def _card_path(output: Path) -> Path:
    """Return the path of the card of a map: part.card.pdf beside part.map.h5."""
    return beside(output, ".card.pdf")
