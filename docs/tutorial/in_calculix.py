"""The test with an exported card in CalculiX: `python in_calculix.py card/card.inp my_test/Image.csv`.

Writes `sheet.inp`, a quarter of the plate with the card as it is, runs `ccx` and prints the force at every picture beside the measured one.
"""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np

from meshes import quads
from meshes.known_specimens import SPECIMENS

PULL, PICTURES = 30.0, 8  # mm at each end, in equal steps
DECK = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=CPS8, ELSET=E
{cells}
{card}*SOLID SECTION, ELSET=E, MATERIAL=EQUIGAP
1.0
*NSET, NSET=RIGHT
{right}
*BOUNDARY
{held}
"""
STEP = """*STEP, NLGEOM, INC=100
*STATIC
0.5, 1.0
*BOUNDARY
RIGHT, 1, 1, {pull}
*NODE PRINT, NSET=RIGHT, FREQUENCY=1000, TOTALS=ONLY
RF
*END STEP
"""


def rows(values):
    """Lines of numbers."""
    return "\n".join(", ".join(map(str, row)) for row in values)


def deck(card: str) -> str:
    """The input of CalculiX: half of the plate is that of the other half."""
    mesh = quads(SPECIMENS["plate_with_hole"](), quarter=True, size_factor=2.0)
    sides = ("symmetry_x", 1), ("symmetry_y", 2), ("right", 2)
    start = DECK.format(
        nodes=rows((i + 1, *map(float, mesh.points[i]), 0.0) for i in np.unique(mesh.cells[:, :8])),
        cells=rows((k, *(cell[:8] + 1)) for k, cell in enumerate(mesh.cells, 1)),
        card=card,
        right=",\n".join(str(i + 1) for i in mesh.boundary_nodes("right")),
        held=rows((i + 1, axis, axis) for side, axis in sides for i in mesh.boundary_nodes(side)),
    )
    return start + "".join(STEP.format(pull=PULL * (k + 1) / PICTURES) for k in range(PICTURES))


def main(card: str, record: str) -> None:
    """Solve and compare."""
    Path("sheet.inp").write_text(deck(Path(card).read_text()))
    subprocess.run(["ccx", "sheet"], check=True, stdout=subprocess.DEVNULL)
    totals = [line.split() for line in Path("sheet.dat").read_text().splitlines()]
    solved = [2 * float(words[0]) for words in totals if len(words) == 3]  # both halves
    with Path(record).open() as file:
        measured = [float(row[-1]) for row in list(csv.reader(file, delimiter=";"))[2:]]
    print("picture  measured, N  CalculiX, N")
    for k, (ours, theirs) in enumerate(zip(measured, solved, strict=True), 1):
        print(f"{k:7d}  {ours:11.3f}  {theirs:11.3f}")
    error = np.linalg.norm(np.subtract(solved, measured)) / np.linalg.norm(measured)
    print(f"relative difference {error:.2%}")


if __name__ == "__main__":
    main(*sys.argv[1:])
