"""One run of `cmm-align` with its parts timed: ``BEGIN=$(date +%s.%N) python align_parts.py ARGUMENTS``.

Prints one line of JSON: seconds from the start of the process to the imports done, reading, the stage cut at
what it says it is doing, writing, the rest. In the loop over all points the time is split by processor
time between looking up places on the surface (seeds and foot points) and the rest (solve).
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise

BEGIN = float(os.environ.get("BEGIN", time.time()))
SPENT: dict[str, float] = {}
LOCATE = {"cpu": 0.0}
LOCK = threading.Lock()


def timed(name: str, module: str, attribute: str) -> None:
    """Add up the wall time of a function, under a name."""
    owner = importlib.import_module(module)
    work = getattr(owner, attribute)

    @functools.wraps(work)
    def watched(*args: object, **kwargs: object) -> object:
        begin = time.perf_counter()
        try:
            return work(*args, **kwargs)
        finally:
            SPENT[name] = SPENT.get(name, 0.0) + time.perf_counter() - begin

    setattr(owner, attribute, watched)


def located(module: str, attribute: str) -> None:
    """Add up the processor time of a look-up, over all threads."""
    owner = importlib.import_module(module)
    work: Callable[..., object] = getattr(owner, attribute)

    @functools.wraps(work)
    def watched(*args: object, **kwargs: object) -> object:
        begin = time.thread_time()
        try:
            return work(*args, **kwargs)
        finally:
            with LOCK:
                LOCATE["cpu"] += time.thread_time() - begin

    setattr(owner, attribute, watched)


def staged() -> None:
    """Cut the stage at what it tells of its progress."""
    owner = importlib.import_module("cmm_align.stages.align")
    work = owner.align

    @functools.wraps(work)
    def watched(*args: object, **kwargs: object) -> object:
        marks: list[tuple[str, float, float, float]] = []

        def tell(what: str, _share: float) -> None:
            marks.append((what, time.perf_counter(), time.process_time(), LOCATE["cpu"]))

        tell("preparing", 0.0)
        found = work(*args, **{**kwargs, "progress": tell})
        tell("done", 1.0)
        for (what, wall, cpu, there), (_, wall2, cpu2, there2) in pairwise(marks):
            if what == "second path":
                SPENT["check"] = SPENT.get("check", 0.0) + wall2 - wall
            else:
                share = min(1.0, (there2 - there) / max(cpu2 - cpu, 1e-9))
                SPENT["locate"] = SPENT.get("locate", 0.0) + share * (wall2 - wall)
                SPENT["solve"] = SPENT.get("solve", 0.0) + (1.0 - share) * (wall2 - wall)
        return found

    owner.align = watched


def main() -> None:
    """Run the command and print the parts."""
    from cmm_align.cli import main as cli

    for module in ("cli.align", "cli.alignment_run", "cli.show", "io", "files", "stages.align"):
        importlib.import_module(f"cmm_align.{module}")
    SPENT["import"] = time.time() - BEGIN
    timed("read", "cmm_align.files", "read_nominal_any")
    timed("read", "cmm_align.files", "read_measured")
    timed("checksum", "cmm_align.cli.record", "steps")
    timed("write", "cmm_align.io", "write")
    for attribute in ("foot_points", "shifted_feet", "seeds", "locate"):
        located("cmm_align.surfaces.distance", attribute)
    staged()
    code = cli.outcome_of(sys.argv[1:])
    SPENT["other"] = time.time() - BEGIN - sum(SPENT.values())
    print(json.dumps({"exit_code": code, **SPENT}))


if __name__ == "__main__":
    main()
