"""What machines say, line by line: pure functions from bytes to points, without a port and without a file.

A stream goes through `framing` (whole lines), one of the `DIALECTS` (events: points, rejected lines, notes)
and `points_of`. A new dialect is one module with `begin`, `step` and `end`, one line in `decoding.DIALECTS`
and one in each table of `profile` that names the dialects.
"""

from cmm_align.dialects.decoding import DIALECTS, decoded, points_of
from cmm_align.dialects.events import SERIOUS_SEVERITY, Dialect, Event, Hit, Note, Rejected, State
from cmm_align.dialects.framing import LONGEST_LINE, lines_of, unfinished
from cmm_align.dialects.profile import MachineProfile, profile_of, read_profile
from cmm_align.dialects.suspicion import suspicions

__all__ = [
    "DIALECTS",
    "LONGEST_LINE",
    "SERIOUS_SEVERITY",
    "Dialect",
    "Event",
    "Hit",
    "MachineProfile",
    "Note",
    "Rejected",
    "State",
    "decoded",
    "lines_of",
    "points_of",
    "profile_of",
    "read_profile",
    "suspicions",
    "unfinished",
]
