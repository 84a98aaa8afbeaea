"""The house rules, walked by machine: doors between rooms, sizes of files, words that have no place."""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest
from source_trees import nodes_of, text_of, tree_of

import cmm_align
from cmm_align import errors

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "cmm_align"
FILES = sorted(PACKAGE.rglob("*.py"))
SHARED = {"errors", "units", "pose", "model", "config", "provenance"}

DOORS = {
    "errors": set(),
    "units": {"errors"},
    "toml_table": {"errors"},
    "pose": {"errors", "numerics"},
    "limits": set(),
    "config": {"errors", "limits", "toml_table"},
    "provenance": {"errors"},
    "model": {"errors", "pose", "surfaces"},
    "numerics": {"errors"},
    "surfaces": {"numerics", "errors", "units", "pose", "toml_table"},
    "stages": {"surfaces", "numerics", "model", "pose", "config", "errors", "units"},
    "io": SHARED | {"surfaces"},
    "dialects": SHARED | {"toml_table"},
    "formats": SHARED | {"surfaces", "toml_table", "dialects"},
    "device": SHARED | {"surfaces", "dialects"},
    "report": SHARED | {"surfaces"},
    "posts": SHARED | {"surfaces", "numerics", "io", "formats", "toml_table"},
    "files": SHARED | {"io", "formats", "surfaces", "dialects", "device"},
    "virtual": {"surfaces", "pose", "units"},
    "selftest": SHARED | {"surfaces", "numerics", "stages", "device", "virtual"},
}
"""What each room may import from the package, itself always; `cli` may use all."""

SINGLE_IMPORTER = {
    "h5py": "io",
    "sqlite3": "io",
    "serial": "device",
    "matplotlib": "report",
    "jinja2": "report",
    "trimesh": "formats",
    "OCP": "formats",
    "startinpy": "surfaces",
    "click": "cli",
    "rich": "cli",
}

FORMATS_MAY = {"io.atomic"}
"""Writing whole or not at all is one mechanism, and it lives in io."""

MOST_LINES = 400


def room_of(path: Path) -> str:
    """Return the room a file belongs to: its folder, or its own name at the top."""
    inside = path.relative_to(PACKAGE)
    return inside.parts[0] if len(inside.parts) > 1 else inside.stem


@cache
def imports_of(path: Path, *, at_import: bool = False) -> set[str]:
    """Return the modules a file imports; with `at_import` only those that importing it loads."""
    found: set[str] = set()

    def walk(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if at_import and isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            if at_import and isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
                continue
            if isinstance(child, ast.Import):
                found.update(alias.name for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{path}: relative import"
                module = child.module or ""
                found.add(module)
                if module.startswith("cmm_align"):
                    found.update(f"{module}.{alias.name}" for alias in child.names)
            walk(child)

    walk(tree_of(path))
    return found


def rooms_imported(path: Path) -> set[str]:
    """Return the rooms of the package that a file opens a door to."""
    rooms = set()
    for name in imports_of(path):
        parts = name.split(".")
        if parts[0] == "cmm_align" and len(parts) > 1:
            rooms.add(parts[1])
    return rooms


def is_room(name: str) -> bool:
    return (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file()


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_room_opens_only_the_doors_it_may(path: Path) -> None:
    room = room_of(path)
    if room in {"cli", "__init__", "__main__"}:
        return

    used = {other for other in rooms_imported(path) if is_room(other)} - {room}
    if room == "formats" and any(name.startswith("cmm_align.io.atomic") for name in imports_of(path)):
        used -= {"io"}

    assert used <= DOORS[room], f"{path.name}: {room} may not import {sorted(used - DOORS[room])}"


def test_nobody_imports_the_command_line() -> None:
    guilty = [
        path.name
        for path in FILES
        if "cli" in rooms_imported(path) and room_of(path) not in {"cli", "__main__"}
    ]

    assert guilty == []


@pytest.mark.parametrize(("package", "room"), SINGLE_IMPORTER.items())
def test_a_dependency_has_one_importer(package: str, room: str) -> None:
    guilty = [
        str(path.relative_to(PACKAGE))
        for path in FILES
        if any(name.split(".")[0] == package for name in imports_of(path)) and room_of(path) != room
    ]

    assert guilty == []


def test_numerics_imports_numpy_scipy_and_errors_only() -> None:
    allowed = {"__future__", "numpy", "scipy", "cmm_align", "collections", "dataclasses", "typing", "math"}
    allowed |= {"functools", "itertools", "enum", "concurrent", "os"}
    for path in (PACKAGE / "numerics").glob("*.py"):
        tops = {name.split(".")[0] for name in imports_of(path)}

        assert tops <= allowed, f"{path.name}: {sorted(tops - allowed)}"


def test_stages_are_pure() -> None:
    banned = {"pathlib", "io", "time", "datetime", "random", "sys", "tempfile", "logging", "warnings"}
    for room in ("stages", "numerics", "surfaces"):
        for path in (PACKAGE / room).rglob("*.py"):
            tops = {name.split(".")[0] for name in imports_of(path)}
            text = text_of(path)

            assert tops.isdisjoint(banned), f"{path.name}: {sorted(tops & banned)}"
            drawn = re.findall(r"numpy\.random import (.*)|(np\.random)", text)
            if path.name == "monte_carlo.py":  # the one that simulates, from a seed
                assert drawn == [("default_rng", "")]
                assert "default_rng(seed)" in text
            else:
                assert drawn == [], path.name
            assert set(re.findall(r"\bos\.(\w+)", text)) <= {"cpu_count", "process_cpu_count"}, path.name
            assert not re.search(r"\bopen\(", text), path.name


def test_no_cycles_between_modules() -> None:
    known = {".".join(("cmm_align", *p.relative_to(PACKAGE).with_suffix("").parts)): p for p in FILES}
    known = {name.removesuffix(".__init__"): path for name, path in known.items()}
    graph = {
        name: {other for other in imports_of(path, at_import=True) if other in known and other != name}
        for name, path in known.items()
    }
    # `from package import module` names the package too; the package itself does not depend on that.
    graph = {
        name: {o for o in others if not any(o != p and p.startswith(f"{o}.") for p in others)}
        for name, others in graph.items()
    }
    state: dict[str, int] = {}

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert state.get(name) != 1, f"cycle: {' -> '.join((*trail, name))}"
        if name in state:
            return
        state[name] = 1
        for other in sorted(graph[name]):
            visit(other, (*trail, name))
        state[name] = 2

    for name in sorted(graph):
        visit(name, ())


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_is_small_and_has_no_loose_ends(path: Path) -> None:
    text = text_of(path)
    calls = [n.func.id for n in nodes_of(path) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]

    assert len(text.splitlines()) <= MOST_LINES
    assert "print" not in calls
    assert not any(isinstance(node, ast.Assert) for node in nodes_of(path)), (
        "an assert is not an error message"
    )
    assert not re.search(r"\b(TODO|FIXME|XXX)\b", text)
    assert path.stem not in {"utils", "util", "helpers", "common", "misc"}


def test_exit_codes_are_the_contract() -> None:
    codes = {
        cls.__name__: cls.exit_code
        for cls in vars(errors).values()
        if isinstance(cls, type) and issubclass(cls, errors.CmmAlignError)
    }

    assert codes["UsageError"] == 2
    assert codes["InputError"] == codes["UnitsError"] == codes["WrongStageError"] == 3
    assert codes["NumericsError"] == 4
    assert codes["DeviceError"] == 7
    assert codes["OutputError"] == codes["OutputExistsError"] == codes["OutputLockedError"] == 8


def test_conversion_factors_live_in_units_only() -> None:
    for path in FILES:
        if path.name == "units.py":
            continue
        numbers = [
            n.value for n in nodes_of(path) if isinstance(n, ast.Constant) and isinstance(n.value, float)
        ]

        assert 25.4 not in numbers, path.name


def test_the_version_stands_in_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    assert project["dynamic"] == ["version"]
    assert metadata.version("cmm-align") == cmm_align.__version__
