"""Work on long arrays piece by piece, on all cores: temporaries stay in cache, sums in a fixed order."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

T = TypeVar("T")

CHUNK: Final = 16384
"""Points handled at once: temporaries stay in cache. Fixed, so that sums are reproducible."""

_MOST_WORKERS: Final = 8


def chunks(n: int, size: int = CHUNK) -> Iterator[slice]:
    """Cut n points into slices of `size`."""
    return (slice(k, min(k + size, n)) for k in range(0, n, size))


def in_threads(work: Callable[[slice], T], n: int, size: int = CHUNK) -> list[T]:
    """Run `work` on every chunk, on all cores, and return the results in the order of the chunks."""
    parts = list(chunks(n, size))
    workers = min(len(parts), os.cpu_count() or 1, _MOST_WORKERS)
    if workers <= 1:
        return [work(part) for part in parts]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, parts))
