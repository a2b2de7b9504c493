"""The pages of docs/reference: the modules of the tree in, one page a package with a section a folder out (`make numbers`)."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "meshes": "Specimens to quads, triangles and hexes.",
    "forward": "Mesh, material and loading to equilibrium states and reaction forces.",
    "calibrate": "Experiment to model, and which effects the model lacks.",
    "studies": "What scripts and notebooks use of the studies; the rest are commands.",
}
ORDER = (
    "data",
    "equations",
    "models",
    "fitting",
    "effects",
    "diagnosis",
)  # the path of the data; other folders follow by name
OF_STUDIES = ("accuracy", "importers", "synthetic", "output")
FOLDERS = {
    "calibrate.data": "What was measured: the Experiment and its files.",
    "calibrate.equations": "Kinematics, recovery, virtual fields, equilibrium, weights, reduction.",
    "calibrate.models": "Networks, splines, and the model file.",
    "calibrate.fitting": "Calibration of a network, its uncertainty, networks fitted to stress.",
    "calibrate.effects": "The catalogue of effects, and the chain that applies them.",
    "calibrate.diagnosis": "Score test, selection, joint fit, verdict.",
    "studies.accuracy": "Errors of a calibrated model.",
    "studies.importers": "Measured data to an Experiment.",
    "studies.synthetic": "The synthetic camera and its errors.",
    "studies.output": "Writing, manifests, folders, reports.",
}


def modules(folder: Path) -> list[str]:
    """Dotted names of the public modules of a folder."""
    names = sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))
    return [".".join([*folder.relative_to(ROOT).parts, name]) for name in names]


def folders(package: str) -> list[Path]:
    """The packages within a package, each followed by its own."""
    root = ROOT / package
    found = [path.parent for path in root.rglob("__init__.py") if path.parent != root]
    if package == "studies":
        found = [folder for folder in found if folder.relative_to(root).parts[0] in OF_STUDIES]
    return sorted(found, key=lambda folder: place(folder.relative_to(root).parts))


def place(parts: tuple[str, ...]) -> tuple[int, tuple[str, ...]]:
    """Sorts folders along the path of the data, others by name behind them."""
    return ORDER.index(parts[0]) if parts[0] in ORDER else len(ORDER), parts


def sentence(folder: Path) -> str:
    """What a folder is for: as stated here, or the first line of its docstring."""
    name = ".".join(folder.relative_to(ROOT).parts)
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    return FOLDERS.get(name) or (text or "").split("\n")[0]


def page(package: str) -> str:
    """Markdown of one page."""
    lines = [f"# `{package}`", PACKAGES[package]]
    if package != "studies":
        lines += [f"::: {name}" for name in modules(ROOT / package)]
    for folder in folders(package):
        lines += [
            f"## Folder `{folder.relative_to(ROOT / package)}`",
            sentence(folder),
            *(f"::: {name}" for name in modules(folder)),
        ]
    return "\n\n".join(line for line in lines if line) + "\n"


if __name__ == "__main__":
    for package in PACKAGES:
        (ROOT / "docs" / "reference" / f"{package}.md").write_text(page(package))
