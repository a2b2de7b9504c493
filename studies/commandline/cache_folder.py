"""The folder in which the user's machine keeps what can be fetched or made again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """``$XDG_CACHE_HOME/equigap``, else ``~/.cache/equigap``."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "equigap"
