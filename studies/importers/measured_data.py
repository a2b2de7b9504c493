"""Where measured data are found. None of them is part of this project.

In: the name of a data set or a file. Out: its path. Looked for, in this order:

1. the folder named by the environment variable ``EQUIGAP_DATA``, laid out as in docs/import.md;
2. the cache (``$XDG_CACHE_HOME/equigap``, else ``~/.cache/equigap``);
3. the public source, a fixed commit of the repository of the authors; what is fetched must have the digest
   written here (of the bytes of a file, or of the numbers of a sheet) and goes to the cache.

Else `DataNotFoundError` says which file to put where.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pooch

from calibrate import errors
from studies.commandline.cache_folder import cache_folder
from studies.importers import printed_sheets
from studies.output import track, write_npz

VARIABLE = "EQUIGAP_DATA"
TIMEOUT_S, PARALLEL = 30.0, 8
_RAW = "https://raw.githubusercontent.com"
SHEETS_SOURCE = f"{_RAW}/tajtac/node_inv/d6d2525b71fb5906409d4065d56651b6f785fb1c/data/manu"
TRELOAR_SOURCE = f"{_RAW}/NEFM-TUDresden/whenInvariantsMatter/6139f3e8e22019a706141ec179d35b89961cb15d"
COLLECTION_SOURCE = f"{_RAW}/Chongran-Zhao/Hyperelastic-fitting/ff0e03c66bdb859316165e8a41f88f4180b90554"


@dataclass(frozen=True)
class Sheet:
    """A published DIC sheet: frames, digest of its displacements (float32, in pixels) and of its force record."""

    frames: int
    displacements: str
    record: str


SHEETS = {
    "Soft_Homo": Sheet(
        189,
        "cd7fa75dffa065920a771ea8fe918119eed5f716ec8b7bda3425d459ae7da86e",
        "59045298e0575cb3adc4b20da058bce87a6dec16bc7cf4e580ca119837735285",
    ),
    "Stiff2_Homo": Sheet(
        187,
        "61dd315369c8882a8f17c78f314e497a68444557e515cf8c538e530399fba726",
        "b8167fd66b01fc7ce3eabce78383755b6b3974efb2af8b17ce77cc0c602bea68",
    ),
    "Stiff2_Hetero": Sheet(
        157,
        "d9e4beefa1a6d0055916af3f6c3bf01fbbab7c35a117c88e937887f9b50ad280",
        "a3b2c948dc9d6a1324ba88b97f65f6a8051174c3160bb54861c7491d78f4d1b1",
    ),
}

# relative path -> (address, sha256 of the file)
FILES = {
    "dammass_kalina_treloar_brain/treloarData/treloar_0.csv": (
        f"{TRELOAR_SOURCE}/treloarData/treloar_0.csv",
        "efd27a87ac6a0a8fa9a63d019d703f7f61db2bf7f113b02833d28bd5ab3d1e0a",
    ),
    "dammass_kalina_treloar_brain/treloarData/treloar_1.csv": (
        f"{TRELOAR_SOURCE}/treloarData/treloar_1.csv",
        "4fca340be26a138031bf021312bf9773764bcb27799ecfefd840f5a5fa1e534a",
    ),
    "dammass_kalina_treloar_brain/treloarData/treloar_2.csv": (
        f"{TRELOAR_SOURCE}/treloarData/treloar_2.csv",
        "01177bdfa8f621558930dcb682eac0c0fd3cfb48da88dc7849fa32a675f6e246",
    ),
    "chongran_zhao_homogeneous/Treloar_1944/UT/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Treloar_1944/UT/stress_stretch.txt",
        "fc70175aed290e13c5feaa4236bab22e998349ba5e546f29f38bcc15a7fce8ae",
    ),
    "chongran_zhao_homogeneous/Treloar_1944/ET/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Treloar_1944/ET/stress_stretch.txt",
        "723add7dd871870797cb44e4fecdd6e074336df58314180bd4681cecca460417",
    ),
    "chongran_zhao_homogeneous/Treloar_1944/PS/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Treloar_1944/PS/stress_stretch.txt",
        "f88ad3c388212b604fb2432371b7e2b190a36affeaaaba5cf3d83c69466f7988",
    ),
    "chongran_zhao_homogeneous/Kawabata_1981/UT/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Kawabata_1981/UT/stress_stretch.txt",
        "a6bce73289454355efa3a57429cfa763ffe0a3386c82a11f1bfb8a65a2fcc577",
    ),
    "chongran_zhao_homogeneous/Kawabata_1981/ET/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Kawabata_1981/ET/stress_stretch.txt",
        "51d5ce99b8f5e36e5b39b32000b1b3646fc43dabb2721b70d067dd26a7be23e1",
    ),
    "chongran_zhao_homogeneous/Kawabata_1981/PS/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Kawabata_1981/PS/stress_stretch.txt",
        "4ad62c0e716884bfaf388bb4b1d733b6edd5b44f66cdfa1c3384fd7981ff5d7f",
    ),
    "chongran_zhao_homogeneous/Meunier_2008/UT/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Meunier_2008/UT/stress_stretch.txt",
        "9be3125ac7dd5fb8a7a6c701d36cbab59699a5707f45c8814d57785c46ce3c5b",
    ),
    "chongran_zhao_homogeneous/Meunier_2008/ET/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Meunier_2008/ET/stress_stretch.txt",
        "09f7d9545e394af2fb722dcd15d9d07cf6d00e5a38ce69c8c99b288249111ce9",
    ),
    "chongran_zhao_homogeneous/Meunier_2008/PS/stress_stretch.txt": (
        f"{COLLECTION_SOURCE}/Meunier_2008/PS/stress_stretch.txt",
        "6887c2338c1c1e157475555844b267665bc114738835c456c016af6fda23ba10",
    ),
}

Fetch = Callable[[str, str | None, Path], None]  # address, sha256, where to


def folder() -> Path | None:
    """The folder named by EQUIGAP_DATA. Raises `DataNotFoundError` when it does not exist."""
    named = os.environ.get(VARIABLE)
    if not named:
        return None
    path = Path(named).expanduser()
    if not path.is_dir():
        raise errors.DataNotFoundError(f"{VARIABLE} names {path}, which is no folder; correct it or unset it")
    return path


def download(address: str, digest: str | None, path: Path) -> None:
    """Fetch an address to `path`, whole or not at all. digest: sha256 of the bytes, None: not known.

    Raises `OSError`, `ValueError` for bytes with another digest.
    """
    pooch.get_logger().setLevel("WARNING")
    downloader = pooch.HTTPDownloader(timeout=TIMEOUT_S)
    pooch.retrieve(address, digest and f"sha256:{digest}", path.name, path.parent, downloader=downloader)


def find(relative: str, fetch: Fetch = download) -> Path:
    """Path of a data file named relative to the data folder, such as 'kawabata_jl/kawabata1981_biaxial.csv'.

    Raises `DataNotFoundError`.
    """
    for root in (folder(), cache_folder()):
        if root is not None and (root / relative).is_file():
            return root / relative
    if relative not in FILES:
        raise _not_found(relative, "it has no public source in this form")
    address, digest = FILES[relative]
    try:
        fetch(address, digest, cache_folder() / relative)
    except ValueError as error:
        raise _not_found(relative, f"{address} has changed: its checksum is not the expected one") from error
    except OSError as error:
        raise _not_found(relative, f"fetching {address} failed: {error}") from error
    return cache_folder() / relative


def sheet(name: str, fetch: Fetch = download) -> Path:
    """Path of the packed ``.npz`` of a printed elastomer sheet; see `SHEETS` for the names.

    Fetching reads the original frames (one CSV each) and packs them. Raises `ConfigError` for an unknown name,
    `DataNotFoundError`.
    """
    if name not in SHEETS:
        raise errors.ConfigError(f"sheet '{name}' unknown; choose one of {', '.join(SHEETS)}")
    relative = f"printed_elastomer_dic/{name}.npz"
    for root in (folder(), cache_folder()):
        if root is not None and (root / relative).is_file():
            return root / relative
    try:
        content = _fetch_sheet(name, fetch)
    except (OSError, ValueError) as error:
        raise _not_found(relative, f"fetching its frames from {SHEETS_SOURCE} failed: {error}") from error
    write_npz(cache_folder() / relative, **content)
    return cache_folder() / relative


def _fetch_sheet(name: str, fetch: Fetch) -> dict[str, np.ndarray]:
    expected, base = SHEETS[name], f"{SHEETS_SOURCE}/{name}_Final_42x41"
    addresses = [f"{base}/{name}_Final{k:04d}.csv" for k in range(1, expected.frames + 1)]
    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(PARALLEL) as pool:
        jobs = [pool.submit(fetch, a, None, Path(temporary) / a.rsplit("/", 1)[1]) for a in addresses]
        for job in track(jobs, f"fetching {name}", unit="frames"):
            job.result()
        frames = printed_sheets.read_frames(temporary)
        record_file = Path(temporary) / "force_disp"
        fetch(f"{base}/force_disp.csv", expected.record, record_file)
        table = printed_sheets.read_table(
            record_file, printed_sheets.RECORD_COLUMNS, printed_sheets.Layout(units_row=True)
        )
    u = frames.displacements.astype(np.float32)
    if displacement_digest(u) != expected.displacements:
        raise ValueError("the published files have changed: checksums differ")
    return {
        "x_px": frames.points[:, 0].astype(np.float32),
        "y_px": frames.points[:, 1].astype(np.float32),
        "ux_px": u[..., 0],
        "uy_px": u[..., 1],
        "time_s": table["Time"],
        "disp_mm": table["Displacement"],
        "force_N": table["Force"],
        "frame_rate_hz": np.array(printed_sheets.FRAME_RATE_HZ),
    }


def displacement_digest(u: np.ndarray) -> str:
    """sha256 of displacements (n_frames, n, 2) as little-endian float32."""
    # adding zero turns -0.0 into 0.0: equal numbers, equal digest
    return hashlib.sha256((np.ascontiguousarray(u, dtype="<f4") + np.float32(0)).tobytes()).hexdigest()


def _not_found(relative: str, why: str) -> errors.DataNotFoundError:
    root = os.environ.get(VARIABLE)
    place = (
        f"{root}/{relative}"
        if root
        else f"{cache_folder()}/{relative}, or set {VARIABLE} to a folder that has {relative}"
    )
    return errors.DataNotFoundError(f"data file {relative} not found ({why}); put it at {place}; see docs/import.md")
