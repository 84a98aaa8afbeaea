"""The papers are complete: help texts, README, docstrings, the documented settings."""

from __future__ import annotations

import ast
import re
import tomllib
from dataclasses import asdict
from pathlib import Path

import click
import pytest
from source_trees import tree_of

import cmm_align
from cmm_align.cli.main import COMMANDS
from cmm_align.cli.main import cmm_align as group
from cmm_align.config import Config

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "cmm_align"
README = (ROOT / "README.md").read_text(encoding="utf-8")
FILES = sorted(PACKAGE.rglob("*.py"))
CHAIN = ("cmm-align offset", "cmm-align align", "cmm-align error-map", "cmm-align compensate")
SHAPES_IN_PROTOCOL = {"jet", "contains"}
"""Methods of every surface: `Surface` states their shapes once for all."""
ARRAYS = re.compile(r"\b(Array|NDArray|ArrayLike)\b")


def public_objects(path: Path) -> list[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    """Return the public functions, classes and methods of a file by their dotted names."""
    found: list[tuple[str, ast.FunctionDef | ast.ClassDef]] = []

    def walk(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                found.append((prefix + node.name, node))
                if isinstance(node, ast.ClassDef):
                    walk(node.body, f"{prefix}{node.name}.")

    walk(tree_of(path).body, "")
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_help_that_ends_with_the_chain_and_a_place_in_the_readme(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    with click.Context(command, info_name=name) as context:
        text = command.get_help(context)

    assert all(line in text for line in CHAIN)
    assert text.rstrip().endswith("part.map.h5")
    assert f"cmm-align {name}" in README
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"{name} {parameter.opts}"


def test_the_group_lists_every_command_without_importing_them() -> None:
    with click.Context(group, info_name="cmm-align") as context:
        text = group.get_help(context)

    assert all(f"  {name}" in text for name in COMMANDS)
    assert all(line in text for line in CHAIN)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_everything_public_has_a_docstring(path: Path) -> None:
    tree = tree_of(path)
    if tree.body:
        assert ast.get_docstring(tree), "no module docstring"

    missing = [
        name
        for name, node in public_objects(path)
        if not ast.get_docstring(node) and not any("overload" in ast.dump(d) for d in node.decorator_list)
    ]

    assert missing == []


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_public_arrays_say_their_shape(path: Path) -> None:
    silent = []
    for name, node in public_objects(path):
        if not isinstance(node, ast.FunctionDef):
            continue
        if node.name in SHAPES_IN_PROTOCOL and path.name != "protocol.py":
            continue
        arrays = [
            a.arg
            for a in [*node.args.args, *node.args.kwonlyargs]
            if a.annotation is not None and ARRAYS.search(ast.unparse(a.annotation))
        ]
        text = ast.get_docstring(node) or ""
        if arrays and "shape" not in text:
            silent.append(name)

    assert silent == []


def test_default_toml_is_the_defaults() -> None:
    table = tomllib.loads((ROOT / "configs" / "default.toml").read_text(encoding="utf-8"))

    assert asdict(Config()) == table


def test_default_toml_explains_what_a_name_does_not_say() -> None:
    lines = (ROOT / "configs" / "default.toml").read_text(encoding="utf-8").splitlines()
    silent = {line.split("=")[0].strip() for line in lines if "=" in line and "#" not in line}

    assert silent <= {"max_iterations", "max_rotation_step_deg"}


@pytest.mark.parametrize("word", ["pytest", "cmm-align align"])
def test_the_two_commands_of_the_readme_are_what_ci_runs(word: str) -> None:
    lines = [line for line in README.splitlines() if re.match(rf"python3 -m venv .*{word}", line)]
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")

    assert len(lines) == 1
    assert f"readme_command {word}" in script or f"readme_command '{word}'" in script


def test_readme_names_every_exit_code_and_every_public_name() -> None:
    for code in (0, 1, 2, 3, 4, 5, 6, 7, 8, 130, 143):
        assert re.search(rf"^\| {code}\b", README, re.MULTILINE), f"exit code {code}"
    for name in ("offset", "align", "error_map", "compensate", "read", "write"):
        assert name in cmm_align.__all__
        assert re.search(rf"\bca\.{name}\(", README), name


def test_readme_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
