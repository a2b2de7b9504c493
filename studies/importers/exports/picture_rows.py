"""Which row of a machine record belongs to which picture, where the record names the pictures (MatchID's `Image.csv`).

In: the words of a column, names of the files of the frames. Out: a row for every frame.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PureWindowsPath

ENDING = re.compile(r"\.(tiff?|bmp|png|jpe?g|raw|pgm|csv|txt|dat)$", re.IGNORECASE)
INSIDE = r"(?<![0-9A-Za-z]){}(?![0-9A-Za-z])"


def rows_of_pictures(words: Sequence[str], frames: Sequence[str]) -> list[int | None]:
    """For every frame the only row whose picture its file name contains as a whole; None: no row, or several."""
    names = [ENDING.sub("", PureWindowsPath(word).name) for word in words]
    patterns = [re.compile(INSIDE.format(re.escape(name)), re.IGNORECASE) if name else None for name in names]
    found: list[int | None] = []
    for frame in frames:
        fitting = [i for i, pattern in enumerate(patterns) if pattern and pattern.search(frame)]
        longest = max((len(names[i]) for i in fitting), default=0)
        fitting = [i for i in fitting if len(names[i]) == longest]
        found.append(fitting[0] if len(fitting) == 1 else None)
    return found
