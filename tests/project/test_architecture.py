"""The house rules of the code: arrows in one direction, no circles, folders and modules that can be held in the head."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("meshes", "forward", "calibrate", "studies")
PLUG_INS = {"calibrate/effects", "studies/importers", "studies/exporters", "forward/laws", "forward/materials"}
SAME_STEMS = {"__init__", "errors", "report", "figures", "tables", "command", "files"}
MOST_MODULES, MOST_LINES, MOST_LINES_OF_A_FUNCTION = 15, 300, 60

# what a package may import, besides itself; the longest prefix counts
CALIBRATE = ["errors", "robust_deviation", "data", "equations", "effects", "models", "fitting", "diagnosis"]
MAY_IMPORT: dict[str, set[str]] = {
    "meshes": set(),
    "forward": {"meshes"},
    "calibrate": {"meshes"},
    **{
        f"calibrate.{name}": {"meshes", *(f"calibrate.{lower}" for lower in CALIBRATE[:i])}
        for i, name in enumerate(CALIBRATE)
    },
    "studies": {"meshes", "forward", "calibrate", "studies"},
}
STUDIES = [
    {"errors"},
    {"output", "commandline"},
    {"importers", "synthetic", "accuracy"},
    {"reports"},
    {"grid", "trials", "sheets", "design", "replay", "polish", "transfer", "decide"},
]
FOUNDATIONS = {"meshes", "forward", "calibrate"}
for level, names in enumerate(STUDIES):
    below = {f"studies.{name}" for lower in STUDIES[:level] for name in lower}
    for name in sorted(names):
        MAY_IMPORT[f"studies.{name}"] = FOUNDATIONS | below | {f"studies.{n}" for n in names}


@cache
def modules() -> dict[str, Path]:
    """Every module of the packages by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = path
    return found


@cache
def imports(name: str) -> frozenset[str]:
    """Modules of the packages that one imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(modules()[name].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {module if module in modules() else node.module for module in whole}
    return frozenset((found & set(modules())) - {name})


def package_of(name: str) -> str:
    """The longest entry of `MAY_IMPORT` that a module belongs to."""
    return max((key for key in MAY_IMPORT if f"{name}.".startswith(f"{key}.")), key=len)


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_arrows_point_one_way(package):
    wrong = []
    for name in modules():
        if package_of(name) != package:
            continue
        for other in imports(name):
            target = package_of(other)
            allowed = target == package or any(f"{target}.".startswith(f"{a}.") for a in MAY_IMPORT[package])
            if not allowed:
                wrong.append(f"{name} imports {other}")
    assert not wrong


@pytest.mark.parametrize("package", PACKAGES)
def test_no_circle_of_imports(package):
    own = [name for name in modules() if f"{name}.".startswith(f"{package}.")]
    try:
        TopologicalSorter({name: imports(name) for name in own}).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_no_crowded_folder():
    count = Counter(str(path.parent.relative_to(ROOT)) for path in modules().values() if path.stem != "__init__")
    assert not {folder: n for folder, n in count.items() if n > MOST_MODULES and folder not in PLUG_INS}


def test_no_name_of_a_module_twice():
    count = Counter(path.stem for path in modules().values() if path.stem not in SAME_STEMS)
    assert not {stem for stem, n in count.items() if n > 1}


def test_no_long_module():
    length = {name: len(path.read_text().splitlines()) for name, path in modules().items()}
    assert not {name: n for name, n in length.items() if n > MOST_LINES}


def test_no_long_function():
    long = {}
    for name, path in modules().items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and node.end_lineno - node.lineno + 1 >= MOST_LINES_OF_A_FUNCTION:
                long[f"{name}.{node.name}"] = node.end_lineno - node.lineno + 1
    assert not long
