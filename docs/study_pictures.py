"""Take the pictures of the pages on studies from finished runs: `python docs/study_pictures.py RESULTS`.

In: the folder with `generalise`, `resolution`, `thickness`, `measured`, `every-third`, `supervised`, `design` (with --validate) and `cross-pattern` (of
`equigap design docs/design/cross_pattern.toml`) as the commands leave them; with names behind it, only these pictures. Out: the pictures of `PICTURES` in
docs/pictures, each with the manifest of the run that made it. Run it in a clone, so that the manifests name a commit.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

TARGET = Path(__file__).resolve().parent / "pictures"
PICTURES = {
    "generalise_predictions_carroll": (
        "generalise/figures/predictions_carroll.png",
        "generalise/figures/predictions_carroll.json",
    ),
    "generalise_matrices_carroll": (
        "generalise/figures/matrices_carroll.png",
        "generalise/figures/matrices_carroll.json",
    ),
    "design_curves": ("design/curves.png", "design/curves.json"),
    "design_validation": ("design/validation.png", "design/validation.json"),
    "design_cross": ("cross-pattern/search.png", "cross-pattern/search.json"),
    "resolution": ("resolution/figures/resolution_weighted.png", "resolution/figures/resolution_weighted.json"),
    "thickness": ("thickness/figures/predictions_weighted.png", "thickness/figures/predictions_weighted.json"),
    "thickness_corrected": (
        "thickness/figures/predictions_thickness-corrected.png",
        "thickness/figures/predictions_thickness-corrected.json",
    ),
    "measured_forces": ("measured/Soft_Homo/replayed_forces.png", "measured/Soft_Homo/report.json"),
    "measured_errors": ("measured/errors.png", "measured/report.json"),
    "measured_stiffness": (
        "measured/transfer_Stiff2_Hetero/stiffness.png",
        "measured/transfer_Stiff2_Hetero/report.json",
    ),
    "every_third": ("every-third/residual_map.png", "every-third/report.json"),
    "supervised": ("supervised/treloar-a.png", "supervised/treloar-a.json"),
}


def main(results: Path, names: list[str]) -> None:
    """Copy the pictures of those names with their manifests, all without names; raises `SystemExit` where one is missing."""
    if unknown := set(names) - set(PICTURES):
        raise SystemExit(f"no picture of the pages: {', '.join(sorted(unknown))}; there are {', '.join(PICTURES)}")
    chosen = {name: pair for name, pair in PICTURES.items() if not names or name in names}
    missing = [name for pair in chosen.values() for name in pair if not (results / name).is_file()]
    if missing:
        raise SystemExit(f"{results}: lacks {', '.join(missing)}; run the command that is named first in each")
    for name, (picture, manifest) in chosen.items():
        shutil.copy(results / picture, TARGET / f"{name}.png")
        content = json.loads((results / manifest).read_text())
        content["inputs"] = {
            Path(path).name: digest for path, digest in content["inputs"].items()
        }  # folders are nobody's business
        content["command"] = [Path(word).name if word.startswith("/") else word for word in content["command"]]
        (TARGET / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("names", nargs="*", metavar="PICTURE")
    given = parser.parse_args()
    main(given.results, given.names)
