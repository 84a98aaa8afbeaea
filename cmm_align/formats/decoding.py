"""Bytes to lines: byte order marks, UTF-16, old code pages, every kind of line end."""

from __future__ import annotations

import codecs
from typing import Final

from cmm_align.errors import MalformedInputError

_SAMPLE: Final = 512
_MOSTLY: Final = 0.4


def decoded(raw: bytes, where: str) -> str:
    r"""Return the text of a file with ``\n`` as its only line end.

    UTF-8 with or without a mark, UTF-16 with or without a mark, else code page 1252.

    Raises
    ------
    MalformedInputError
        If it is not text.
    """
    text = _text(raw, where)
    if "\r\n" in text:
        text = text.replace("\r\n", "\n")
    if "\r" in text:
        text = text.replace("\r", "\n")
    if "\0" in text:
        before = text[: text.index("\0")]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        raise MalformedInputError(
            "a NUL byte: the file is binary or damaged", where=f"{where}:{line}:{column}", expected="text"
        )
    return text


def _text(raw: bytes, where: str) -> str:
    try:
        if raw.startswith(codecs.BOM_UTF8):
            return raw.decode("utf-8-sig")
        if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return raw.decode("utf-16")
        sample = raw[:_SAMPLE]
        if sample[1::2].count(0) > _MOSTLY * len(sample):
            return raw.decode("utf-16-le")
        if sample[0::2].count(0) > _MOSTLY * len(sample):
            return raw.decode("utf-16-be")
    except UnicodeDecodeError as error:
        raise MalformedInputError(
            f"damaged text at byte {error.start} ({error.reason})", where=where, expected=error.encoding
        ) from None
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")  # only comments may use it: numbers must be ASCII
