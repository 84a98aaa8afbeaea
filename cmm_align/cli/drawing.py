"""Drawing for the commands: which pictures, to which files, and what happens where one cannot be drawn.

A picture is never worth the numbers: where the font, matplotlib or the disk fails, the command goes on, says
which picture is missing and why, and leaves with the exit code of an output that could not be written.
"""

from __future__ import annotations

import difflib
import textwrap
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from cmm_align.cli.job import beside
from cmm_align.config import ErrorMapConfig
from cmm_align.errors import CmmAlignError, OutputError, UsageError
from cmm_align.report.pictures import FORMATS, PICTURES, draw
from cmm_align.report.wishes import Limits, Wishes

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap

ALL: Final = "all"
MOST_LETTERS: Final = 160
"""Of what another library says of its failure."""


@dataclass(frozen=True, slots=True)
class Drawings:
    """Which pictures of a map are asked for; the map itself as PNG unless told otherwise.

    Attributes
    ----------
    names : tuple of str
        Of `PICTURES`, in their order.
    formats : tuple of str
        Suffixes.
    sections : tuple of str
        Lines of the sections, as typed.
    every : bool
        Whether all were asked for, without a name: what a map has not to show is then left out.
    """

    names: tuple[str, ...] = ("map",)
    formats: tuple[str, ...] = ("png",)
    sections: tuple[str, ...] = ()
    every: bool = False

    def files(self, output: Path) -> list[tuple[str, Path]]:
        """Return (name, path) of every picture: the map has the stem of the output, others say their name."""
        return [
            (name, output.with_suffix(f".{kind}") if name == "map" else beside(output, f".{name}.{kind}"))
            for name in self.names
            for kind in self.formats
        ]


NO_DRAWINGS: Final = Drawings(())


def parsed(
    pictures: str | None, formats: Sequence[str], sections: Sequence[str], *, none: bool = False
) -> Drawings:
    """Return what the options ask for.

    Parameters
    ----------
    pictures : str or None
        Names with commas between, or ``all``; None for the map.
    formats : sequence of str
        png, svg or both; none for png.
    sections : sequence of str
        Lines to cut along; they ask for the picture of sections too.
    none : bool
        Whether no picture is wanted.

    Raises
    ------
    UsageError
        If a name is not known (the nearest is named), or pictures are asked for and refused at once.
    """
    if none:
        if pictures is not None or sections:
            raise UsageError("--no-picture beside pictures that are asked for", expected="one or the other")
        return NO_DRAWINGS
    words = [word.strip().lower() for word in ("map" if pictures is None else pictures).split(",")]
    for word in words:
        if word not in {*PICTURES, ALL}:
            near = difflib.get_close_matches(word, [*PICTURES, ALL], n=1, cutoff=0.4)
            known = f"{', '.join(PICTURES)} or {ALL}"
            raise UsageError(
                f"there is no picture {word!r}",
                expected=known,
                remedy=f"did you mean {near[0]}?" if near else "",
            )
    every = ALL in words
    names = {*words, *(["sections"] if sections else [])}
    wanted = {*FORMATS} if "both" in formats else {*formats} or {"png"}
    return Drawings(
        tuple(name for name in PICTURES if every or name in names),
        tuple(kind for kind in FORMATS if kind in wanted),
        tuple(sections),
        every,
    )


def limits_of(config: ErrorMapConfig, drawings: Drawings) -> Limits | None:
    """Return the limits of single deviations that the tolerances give; None without one.

    Those of a band where there is one; else half of the profile (ISO 1101: a zone about the nominal) or of PV
    on either side.

    Raises
    ------
    UsageError
        If there is none, but a picture was asked for that is nothing without.
    """
    low_um, high_um = config.tolerance_band_lower_um, config.tolerance_band_upper_um
    if low_um < high_um:
        return Limits(low_um, high_um, "tolerance band")
    for name, width_um in (("profile", config.tolerance_profile_um), ("PV", config.tolerance_pv_um)):
        if width_um > 0.0:
            half_um = 0.5 * width_um
            return Limits(-half_um, half_um, f"half of {name} {width_um:g} µm either side")
    if "bands" in drawings.names and not drawings.every:
        raise UsageError(
            "the picture bands has no limits to show",
            expected="a tolerance of single deviations",
            remedy="add --tolerance-band 5um, --tolerance-profile 10um or --tolerance-pv 10um",
        )
    return None


class Drawn(NamedTuple):
    """What came of the pictures."""

    paths: list[Path]
    """Those that were written."""
    faults: list[str]
    """A sentence for those that failed."""
    notes: list[str]
    """A sentence for those that a map cannot have, where all were asked for."""


def draw_all(
    deviation_map: DeviationMap, drawings: Drawings, output: Path, wishes: Wishes, *, overwrite: bool
) -> Drawn:
    """Draw pictures of a map; a failure stops none of the others.

    Parameters
    ----------
    deviation_map : DeviationMap
    drawings : Drawings
    output : Path
        Of the map.
    wishes : Wishes
    overwrite : bool
        Whether pictures that are there may be replaced.
    """
    drawn: list[Path] = []
    faults: dict[str, list[str]] = {}
    notes: dict[str, str] = {}
    for name, path in drawings.files(output):
        why = nothing_to_show(name, deviation_map, wishes) if drawings.every else ""
        if why:
            notes[name] = f"no picture {name}: {why}"
            continue

        def to(place: Path, name: str = name) -> None:
            draw(name, deviation_map, place, wishes)

        fault = attempt(to, path, overwrite=overwrite)
        if fault:
            faults.setdefault(fault, []).append(named(path))
        else:
            drawn.append(path)
    return Drawn(drawn, [not_drawn(names, why) for why, names in faults.items()], list(notes.values()))


def nothing_to_show(name: str, deviation_map: DeviationMap, wishes: Wishes) -> str:
    """Return why a map cannot have a picture, or nothing."""
    if name == "bands" and wishes.limits is None:
        return "no tolerance of single deviations is given (a band, profile or PV)"
    spectrum = deviation_map.spectrum
    return spectrum.missing if name == "psd" and spectrum is not None else ""


def attempt(drawing: Callable[[Path], None], path: Path, *, overwrite: bool) -> str:
    """Draw one picture whole or not at all; return why it could not be drawn, or nothing.

    Parameters
    ----------
    drawing : callable
        Writes to the path that it is given.
    path : Path
        The picture.
    overwrite : bool
        Whether it may be replaced.
    """
    from cmm_align.io.atomic import atomic_path

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a letter that the font has not is no reason to talk
            with atomic_path(path, overwrite) as place:
                drawing(place)
    except CmmAlignError as error:
        return error.what if not isinstance(error, OutputError) else error.one_line()
    except Exception as error:
        reason = textwrap.shorten(str(error), MOST_LETTERS, placeholder=" ...")
        return f"{type(error).__name__}: {reason}" if reason else type(error).__name__
    return ""


def try_one(drawing: Callable[[Path], None], path: Path, *, overwrite: bool) -> list[str]:
    """Draw one picture; return a warning where it could not be drawn, or none.

    Parameters
    ----------
    drawing : callable
        Writes to the path that it is given; imports what it needs itself.
    path : Path
        The picture.
    overwrite : bool
        Whether it may be replaced.
    """
    fault = attempt(drawing, path, overwrite=overwrite)
    return [not_drawn([named(path)], fault)] if fault else []


def named(path: Path) -> str:
    """Return the name of a picture that failed, with a word on an older one that is still there."""
    return f"{path.name} (the one that is there is older than these numbers)" if path.exists() else path.name


def not_drawn(names: Sequence[str], fault: str) -> str:
    """Return the warning for pictures that could not be drawn."""
    told = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{told} not drawn: {fault}; the numbers are complete (exit code 8 for the missing picture)"
