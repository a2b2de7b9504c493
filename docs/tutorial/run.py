"""Run the tutorial as it stands: `python docs/tutorial/run.py FOLDER [--pictures]`.

In: the ```sh and ```python blocks of docs/tutorial.md, in their order. Out: what they write, in FOLDER, which must be empty.
Fails where a command does, or where the verdict or a value is not the one printed on the page. --pictures: replace those of the page, with their manifests.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "tutorial.md"
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
VERDICT = re.compile(r"explained: second invariant \(c01 = 0.0\d+ \+- 0.00\d+ MPa\)")
VALUE = re.compile(r"^    (\S[^\n]*?\S) {2,}([\d.]+)(?: %)?$", re.MULTILINE)  # a line of a table as a command prints it
SAME = 0.03  # relative: networks that are fitted on two systems differ by up to 1.3 %
PICTURES = {
    "imported": "imported/experiment",
    "curves": "predicted/curves",
    "diagnosis": "found/residual_map",
}


def main(folder: Path, pictures: bool) -> None:
    """Run every block; raises `SystemExit` with what is wrong."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise SystemExit(f"{folder} is not empty")
    text = PAGE.read_text()
    for name in ("stand_in.py", "in_calculix.py"):
        shutil.copy(HERE / name, folder)
    said = ""
    for kind, block in BLOCK.findall(text):
        said += run(kind, block, folder)
    if not VERDICT.search(said) or not VERDICT.search(text):
        raise SystemExit("the verdict is not the one on the page")
    words = " ".join(said.split())
    for name, value in VALUE.findall(BLOCK.sub("", text)):
        found = [float(one) for one in re.findall(re.escape(name) + r" ([\d.]+)", words)]
        if not any(abs(one - float(value)) <= SAME * float(value) for one in found):
            raise SystemExit(f"the page says '{name} {value}', the commands {found or 'nothing of it'}")
    if pictures:
        keep(folder)


def run(kind: str, block: str, folder: Path) -> str:
    """Run a block with this Python's commands first on the path; what it printed."""
    command = ["sh", "-eu", "-c", block] if kind == "sh" else [sys.executable, "-c", block]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    print(block, flush=True)
    done = subprocess.run(command, cwd=folder, env={**os.environ, "PATH": path}, stdout=subprocess.PIPE, text=True)
    print(done.stdout, flush=True)
    if done.returncode:
        raise SystemExit(f"this block of tutorial.md failed:\n{block}")
    return done.stdout


def keep(folder: Path) -> None:
    """Copy the pictures of the page and the manifests of the runs that made them."""
    target = HERE.parent / "pictures"
    target.mkdir(exist_ok=True)
    for name, source in PICTURES.items():
        shutil.copy(folder / f"{source}.png", target / f"{name}.png")
        manifest = folder / f"{source}.json"
        text = (manifest if manifest.exists() else manifest.with_name("report.json")).read_text()
        (target / f"{name}.json").write_text(text.replace(f"{folder}/", ""))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pictures", action="store_true")
    arguments = parser.parse_args()
    main(arguments.folder.resolve(), arguments.pictures)
