"""A region of the nominal from the command line: a short text, or the name of a TOML file."""

from __future__ import annotations

import tomllib

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import load
from cmm_align.surfaces.protocol import Surface
from cmm_align.surfaces.region import Region, region_from_table, region_from_text
from cmm_align.units import mm_per


def read_region(text: str, surface: Surface, units: str | None = None, where: str = "region") -> Region:
    """Return the region that a text describes, itself or through a file.

    Parameters
    ----------
    text : str
        As `region_from_text` takes it, or the name of a file that ends in ``.toml``. The file has a table
        ``[aperture]`` as a prescription has (a prescription will do), or its keys without a table, and
        ``units``.
    surface : Surface
        The nominal.
    units : str, optional
        Unit of a file that states none; mm by default.
    where : str
        What the user wrote the text as, for messages.

    Raises
    ------
    UsageError
        If the text is no region.
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read, or its table is wrong.
    """
    if not text.strip().lower().endswith(".toml"):
        return region_from_text(text, surface, where)
    source = load(text.strip())
    try:
        document = tomllib.loads(decoded(source.raw, source.where))
    except tomllib.TOMLDecodeError as error:
        raise MalformedInputError(f"not valid TOML: {error}", where=source.where) from None
    scale = mm_per(str(document.get("units", units or "mm")), where=f"{source.where}:units")
    bare = {key: value for key, value in document.items() if key not in {"units", "schema"}}
    return region_from_table(document.get("aperture", bare), scale, where=f"{source.where}:aperture")
