"""All output in one place: import from here.

Files are written whole or not at all (`write_*`, `atomic_path`), each figure or table has a record beside it
(`Manifest`), a folder is never overwritten silently (`open_output_folder`), long work shows its progress
(`Progress`, `track`, `callback`).
"""

from studies.output.folder import open_output_folder, released_if_refused
from studies.output.manifest import Manifest
from studies.output.progress import Progress, callback, track
from studies.output.writing import atomic_path, write_bytes, write_csv, write_figure, write_json, write_npz, write_text

__all__ = [
    "Manifest",
    "Progress",
    "atomic_path",
    "callback",
    "open_output_folder",
    "released_if_refused",
    "track",
    "write_bytes",
    "write_csv",
    "write_figure",
    "write_json",
    "write_npz",
    "write_text",
]
