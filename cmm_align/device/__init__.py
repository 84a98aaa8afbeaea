"""The controller port: captured without loss, recorded, and replayed.

The only importer of pySerial. `link` opens a line, `reader` writes every byte into a `journal` before
anything looks at it, `intake` makes points of what the reader hands on, and `capture` puts them together.
`replay` serves recordings in the place of a port, so that live and recorded runs share one path, with
`faults` for tests. `tap` listens to a client and a server that talk over TCP. Nothing is ever sent.
"""

from __future__ import annotations

from cmm_align.device.address import is_port, replay_url
from cmm_align.device.capture import Captured, capture_points, recorded_profile, recording_of
from cmm_align.device.ending import EndReason
from cmm_align.device.intake import Progress
from cmm_align.device.line_errors import LineErrors
from cmm_align.device.recordings import is_journal_file
from cmm_align.device.tap import Endpoint, Tapped, endpoints_of, tap

__all__ = [
    "Captured",
    "EndReason",
    "Endpoint",
    "LineErrors",
    "Progress",
    "Tapped",
    "capture_points",
    "endpoints_of",
    "is_journal_file",
    "is_port",
    "recorded_profile",
    "recording_of",
    "replay_url",
    "tap",
]
