"""How fast text becomes points: ``python tests/bench/text.py [--parsers]``.

Needs Linux for the memory. With ``--parsers`` the numbers alone are read as well, by every parser that is
installed, to judge them by speed and by exactness. What was found with 1.2e6 x 3 numbers (processor seconds:
six decimals / 17 digits; MB installed; seconds to import) on a shared machine with two cores, November 2026:

=================== ============= ======== ======== ===================================================
parser              seconds       MB       import   remarks
=================== ============= ======== ======== ===================================================
np.loadtxt, blocks  0.38 / 1.13   0        0        refuses rows of another length
np.fromstring       0.45 / 1.16   0        0        stops silently, takes ``1-2`` for two numbers
float() of fields   0.49 / 1.21   0        0
msgspec 0.22        0.30 / 0.35   0.7      0.0      JSON: no ``+1``, ``.5``, ``5.``; not a reader of tables
orjson 3.13         0.28 / 0.33   0.3      0.0      the same
pysimdjson 7.0      0.13 / 0.18   7.5      0.0      the same
pandas 3.1          0.17 / 0.22   84       0.7      with its import 0.9 s; 335 MB at its peak
polars 2.1          0.15 / 0.18   180      0.3      no runs of blanks; 370 to 430 MB at its peak
pyarrow 26          0.27 / 0.45   170      0.1      no runs of blanks
fastnumbers 5.2     1.1 to 1.9    7        0.0      wall time; all fields as Python strings first
=================== ============= ======== ======== ===================================================

All of them round correctly: no bit differed in 3.6e6 numbers. NumPy's reader, block by block, was taken: the
rest of the reading (decoding, line ends, the look at characters and columns) costs as much as the numbers
themselves, so the fastest of the others would save about a quarter of a second of the reading, and nothing of
what follows it; none is worth a dependency of 84 to 180 MB, and the light ones read JSON, which would have to
be made from the text and refuses numbers that machines write. For files of 17 digits (of simulations, not of
machines) the difference is 0.8 s of 1.6 s: there orjson would be worth its 0.3 MB.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from table import Row, Stopwatch, show

COUNT = 1_200_000
MOST_SECONDS = 1.2
MOST_MB = 400
REPEATS = 3

MEASURE = (
    "import sys, time\n"
    "from cmm_align.formats import read_points\n"
    "import cmm_align.formats.delimited\n"
    "wall, cpu = -time.perf_counter(), -time.process_time()\n"
    "points = read_points(sys.argv[1])\n"
    "wall, cpu = wall + time.perf_counter(), cpu + time.process_time()\n"
    "status = open('/proc/self/status').read()\n"
    "peak = int(status.split('VmHWM:')[1].split()[0]) / 1024\n"
    "import numpy as np\n"
    "print(wall, cpu, peak, int((points.points_mm != np.load(sys.argv[2])).sum()))\n"
)


def texts(values: np.ndarray) -> dict[str, bytes]:
    """Return the points as files of several kinds."""
    flat = values.ravel().tolist()
    plain = "%.6f,%.6f,%.6f\n" * len(values) % tuple(flat)
    german = plain.replace(",", "\t").replace(".", ",").replace("\n", "\r\n")
    heads = "X [mm]\tY [mm]\tZ [mm]\r\n"
    ids = "".join(f"{k};{line}\n" for k, line in enumerate(plain.replace(",", ";").splitlines()))
    return {
        "regular dump": plain.encode(),
        "German, tabs, CRLF": german.encode(),
        "German, UTF-16, units in the names": (heads + german).encode("utf-16"),
        "aligned columns": ("%14.6f%14.6f%14.6f\r\n" * len(values) % tuple(flat)).encode(),
        "numbered, with a column of words": ("Nr;X;Y;Z;Name\n" + ids.replace("\n", ";MP\n")).encode(),
    }


def main() -> None:
    """Print time and memory of reading beside their bars; with ``--parsers`` those of single parsers."""
    values = np.round(np.random.default_rng(0).uniform(-60.0, 60.0, (COUNT, 3)), 6)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        truth, path = Path(folder, "truth.npy"), Path(folder, "points.txt")
        np.save(truth, values)
        for name, raw in texts(values).items():
            path.write_bytes(raw)
            runs = []
            for _ in range(REPEATS):
                command = [sys.executable, "-c", MEASURE, str(path), str(truth)]
                done = subprocess.run(command, check=True, capture_output=True, text=True)
                runs.append([float(word) for word in done.stdout.split()])
            wall, cpu, peak, off = (min(numbers) for numbers in zip(*runs, strict=True))
            measured = f"{wall:.2f} s ({cpu:.2f} s of one core), {peak:.0f} MB, {off:.0f} numbers off"
            rows.append(Row(name, f"{MOST_SECONDS} s, {MOST_MB} MB", measured))
        show(f"{COUNT} points of text to points, whole process for the memory", rows)
    if "--parsers" in sys.argv[1:]:
        show("the numbers alone", parser_rows(values))


def parser_rows(values: np.ndarray) -> list[Row]:
    """Return what each installed parser needs for the numbers of a regular dump and of full precision."""
    short = texts(values[:2])["regular dump"]  # the same kind of text as the dump
    kinds = {"six decimals": "%.6f,%.6f,%.6f\n", "17 digits": "%r,%r,%r\n"}
    full = np.random.default_rng(0).uniform(-60.0, 60.0, (COUNT, 3))
    rows = []
    for kind, row in kinds.items():
        want = values if kind == "six decimals" else full
        raw = (row * COUNT % tuple(want.ravel().tolist())).encode()
        for name, parse in PARSERS.items():
            try:
                parse(short)
            except ImportError:
                rows.append(Row(f"{name}, {kind}", "", "not installed"))
                continue
            best = float("inf")
            for _ in range(REPEATS):
                with Stopwatch() as watch:
                    got = parse(raw)
                best = min(best, watch.cpu)
            off = int((got.reshape(-1, 3) != want).sum())
            rows.append(Row(f"{name}, {kind}", "", f"{best:.2f} s, {off} numbers off"))
    return rows


def in_blocks(parse: Callable[[bytes], Any]) -> Callable[[bytes], np.ndarray]:
    """Return a parser that takes a text in pieces of whole lines."""

    def parsed(raw: bytes) -> np.ndarray:
        parts, start = [], 0
        while start < len(raw):
            end = raw.find(b"\n", start + (1 << 18)) + 1 or len(raw)
            parts.append(np.asarray(parse(raw[start:end]), dtype=np.float64).ravel())
            start = end
        return np.concatenate(parts)

    return parsed


def as_json(raw: bytes) -> bytes:
    """Return lines of numbers as one JSON array."""
    return b"[" + raw.rstrip(b"\n").replace(b"\n", b",") + b"]"


def of(module: str, parse: Callable[[Any, bytes], Any]) -> Callable[[bytes], Any]:
    """Return a parser of a package that need not be there."""
    return lambda raw: parse(importlib.import_module(module), raw)


def read_with_pandas(pandas: Any, raw: bytes) -> np.ndarray:
    """Return the numbers by pandas' C engine."""
    from io import BytesIO

    return pandas.read_csv(BytesIO(raw), header=None, dtype=float).to_numpy()


def read_with_polars(polars: Any, raw: bytes) -> np.ndarray:
    """Return the numbers by polars."""
    columns = dict.fromkeys("xyz", polars.Float64)
    return polars.read_csv(raw, has_header=False, schema=columns).to_numpy()


def read_with_pyarrow(csv: Any, raw: bytes) -> np.ndarray:
    """Return the numbers by Arrow."""
    from io import BytesIO

    table = csv.read_csv(BytesIO(raw), read_options=csv.ReadOptions(column_names=list("xyz")))
    return np.stack([table[name].to_numpy() for name in "xyz"], axis=1)


PARSERS: dict[str, Callable[[bytes], Any]] = {
    "np.loadtxt": in_blocks(
        lambda raw: np.loadtxt(raw.decode().splitlines(), delimiter=",", comments=None, ndmin=2)
    ),
    "np.fromstring": in_blocks(lambda raw: np.fromstring(raw.replace(b"\n", b",")[:-1], sep=",")),
    "float()": in_blocks(lambda raw: [float(word) for word in raw.replace(b"\n", b",")[:-1].split(b",")]),
    "orjson": in_blocks(of("orjson", lambda orjson, raw: orjson.loads(as_json(raw)))),
    "msgspec": in_blocks(of("msgspec.json", lambda json, raw: json.decode(as_json(raw), type=list[float]))),
    "pandas": of("pandas", read_with_pandas),
    "polars": of("polars", read_with_polars),
    "pyarrow": of("pyarrow.csv", read_with_pyarrow),
}


if __name__ == "__main__":
    main()
