"""From the bytes of a port to points: the dialects by name, and the whole way through one of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from cmm_align.dialects.column_lines import XYZ, XYZ_LETTERS
from cmm_align.dialects.events import Dialect, Event, Hit, Note, Rejected
from cmm_align.dialects.framing import lines_of, unfinished
from cmm_align.dialects.gmserver import GMSERVER
from cmm_align.dialects.ipp import IPP
from cmm_align.dialects.line import Fault, rejected
from cmm_align.dialects.profile import MachineProfile
from cmm_align.model import PointSet

DIALECTS: Final[dict[str, Dialect]] = {dialect.name: dialect for dialect in (XYZ, XYZ_LETTERS, GMSERVER, IPP)}
"""By the name that a profile gives."""


def decoded(chunks: Iterable[bytes], profile: MachineProfile) -> Iterator[Event]:
    """Give the events of a stream, line by line; a fragment at its end is rejected.

    Parameters
    ----------
    chunks : iterable of bytes
        The stream in pieces of any size: where it is cut makes no difference.
    profile : MachineProfile
    """
    dialect = DIALECTS[profile.dialect]
    state, pending, count = dialect.begin(profile), b"", 0
    for chunk in chunks:
        lines, pending = lines_of(pending, chunk, profile.terminator)
        count += len(lines)
        for line in lines:
            state, events = dialect.step(state, line)
            yield from events
    fragment = unfinished(pending)
    if fragment.strip():
        yield rejected(count + 1, fragment, Fault(len(fragment), "cut off: the line has no end"))
    yield from dialect.end(state)


def points_of(
    events: Iterable[Event], source: str, profile: MachineProfile
) -> tuple[PointSet, tuple[Rejected, ...], tuple[Note, ...]]:
    """Return the points among events, and what else there was.

    Parameters
    ----------
    events : iterable of Event
    source : str
        Where they came from, for messages.
    profile : MachineProfile
        Says what the points are.

    Returns
    -------
    points : PointSet
        In the machine's frame, in the order in which they came. Numbers of the machine become `ids` if every
        point has one; sigma likewise.
    rejected : tuple of Rejected
    notes : tuple of Note
        With one more, of line 0, for every gap in the numbers of the points.
    """
    hits: list[Hit] = []
    refused: list[Rejected] = []
    notes: list[Note] = []
    for event in events:
        if isinstance(event, Hit):
            hits.append(event)
        elif isinstance(event, Rejected):
            refused.append(event)
        else:
            notes.append(event)
    ids = [hit.id for hit in hits if hit.id is not None]
    sigma_mm = [hit.sigma_mm for hit in hits if hit.sigma_mm is not None]
    numbered = len(ids) == len(hits) > 0
    points = PointSet.of(
        np.array([hit[:3] for hit in hits], dtype=np.float64).reshape(-1, 3),
        kind=profile.kind,
        frame="machine",
        ids=ids if numbered else None,
        source=source,
        sigma_mm=sigma_mm if len(sigma_mm) == len(hits) > 0 else None,
    )
    return points, tuple(refused), (*notes, *(_gaps(ids) if numbered else ()))


def _gaps(ids: Sequence[int]) -> Iterator[Note]:
    """Give a note for each step in the numbers of points that is not the usual one."""
    numbers = np.array(ids, dtype=np.int64)
    steps = np.diff(numbers)
    usual = int(np.median(steps)) if len(steps) else 1
    for at in np.flatnonzero(steps != usual):
        before, after = int(numbers[at]), int(numbers[at + 1])
        yield Note(
            0,
            f"{before}, {after}",
            f"the numbers of the points go from {before} to {after}: lines may be missing",
        )
