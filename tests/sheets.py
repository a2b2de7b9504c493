"""A small DIC sheet in every form the importers read: frames, packed, column-mapped; for the tests of import."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from calibrate.experiment import Experiment, Noise
from studies import dic_csv
from studies.series import to_experiment
from studies.synchronise import Selection

NOISE = Noise(1e-3)
DATA = os.environ.get("EQUIGAP_DATA")
needs_data = pytest.mark.skipif(
    not DATA or not Path(DATA, "printed_elastomer_dic").is_dir(),
    reason="EQUIGAP_DATA names no folder with printed_elastomer_dic",
)


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding=encoding)
    return path


COLUMNS, ROWS, PITCH, SCALE = 16, 14, 20, 0.05
HEADER = "x [pixel];y [pixel];x-displacement [pixel];y-displacement [pixel];Displacement [pixel]"


def pixels():
    y, x = np.meshgrid(100 + PITCH * np.arange(ROWS), 200 + PITCH * np.arange(COLUMNS), indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(float)


def motion(stretch: float):
    """Displacement in pixels, image coordinates: the lower grip rests, the upper one moves up (y falls)."""
    p = pixels()
    x, y = p[:, 0] - p[:, 0].mean(), p[:, 1] - p[:, 1].max()
    return np.stack([(stretch**-0.5 - 1) * x, (stretch - 1) * y], axis=1)


def frame_text(moved, points=None) -> str:
    rows = [
        f"{x:g};{y:g};{u:.6g};{v:.6g};0"
        for (x, y), (u, v) in zip(pixels() if points is None else points, moved, strict=False)
    ]
    return "\n".join([HEADER, *rows]) + "\n"


def force(time):
    return 0.1 + 2.0 * np.asarray(time)


def record_text(times=np.linspace(0, 10, 101)) -> str:
    rows = [f'"{t:.4f}","{0.4 * t:.4f}","{force(t):.4f}"' for t in times]
    return "Time,Displacement,Force\r\n(s),(mm),(N)\r\n" + "\r\n".join(rows) + "\r\n"


def write_frames(tmp_path: Path) -> Path:
    """Frames every half second: stretch 1 + 0.02 t; 12 frames."""
    for k in range(12):
        write(tmp_path / "sheet" / f"Sheet{k + 1:04d}.csv", frame_text(motion(1 + 0.02 * 0.5 * k)))
    write(tmp_path / "sheet" / "force_disp.txt", record_text())
    return tmp_path / "sheet"


def sheet(folder: Path, selection=Selection(), noise=NOISE, **options) -> Experiment:
    frames = dic_csv.read_frames(folder)
    record = dic_csv.read_record(folder / "force_disp.txt")
    chosen = dic_csv.SheetOptions(**{"scale": SCALE, "frame_rate": 2.0, **options})
    return to_experiment(dic_csv.sheet_series(frames, record, chosen), selection, noise)


def packed(path: Path, **changes) -> Path:
    u = np.stack([motion(1 + 0.01 * k) for k in range(12)]).astype(np.float32)
    p, t = pixels().astype(np.float32), np.linspace(0, 10, 101)
    arrays = {
        "x_px": p[:, 0],
        "y_px": p[:, 1],
        "ux_px": u[..., 0],
        "uy_px": u[..., 1],
        "time_s": t,
        "force_N": force(t),
    }
    arrays = {**arrays, "frame_rate_hz": np.array(2.0), **changes}
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


MAP = """
name = "mapped"
thickness_mm = 2.0
[points]
files = "frames/f*.csv"
x = "X"
y = "Y"
u = "U"
v = "V"
unit = "px"
scale_mm_per_px = 0.05
y_axis = "down"
valid_column = "sigma"
valid_minimum = 0.0
[force]
file = "load.csv"
time = "t"
force = "F"
unit = "kN"
sign = -1.0
[frames]
rate_hz = 2.0
count = 4
tare_N = 0.0
[edges]
loaded = ["bottom", "top"]
free = ["left", "right", "holes"]
[noise]
displacement_std_mm = 0.001
"""


def mapped(tmp_path: Path, text: str = MAP, keep=lambda p: np.ones(len(p), bool), coordinates="reference") -> Path:
    p = pixels()
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(keep(p)))
    for k in range(12):
        u = motion(1 + 0.01 * k)
        shown = p + u if coordinates == "current" else p
        lines = [f"{i},{shown[i, 0]:.6f},{shown[i, 1]:.6f},{u[i, 0]:.6f},{u[i, 1]:.6f},0.01" for i in chosen]
        write(tmp_path / "frames" / f"f_{k}.csv", "n,X,Y,U,V,sigma\n" + "\n".join(lines) + "\n")
    times = np.linspace(0, 10, 101)
    write(tmp_path / "load.csv", "t,F\n" + "\n".join(f"{t:.3f},{-1e-3 * force(t):.7f}" for t in times))
    return write(tmp_path / "map.toml", text)
