"""What a term of a sag is, and the keys that every kind of term knows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, Protocol

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.toml_table import check_keys

PLACING_KEYS: Final = frozenset({"decentre", "tilt_deg"})
"""Keys of any term that move it (see `placed`)."""


class Term(Protocol):
    """One summand of the sag, in the unit of the prescription."""

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives at places of shape (n,); NaN where undefined."""
        ...


def check_term_keys(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse a key that this kind of term does not know.

    Raises
    ------
    MalformedInputError
        At the first unknown key, naming the nearest known one.
    """
    check_keys(table, {"kind", *PLACING_KEYS, *known}, where=where)
