"""Uninstall what equigap does not need when it runs: all that its requirements, and theirs, do not lead to.

Reads the metadata of what is installed; pip stays out of what is kept, and is removed last.
"""

import re
import subprocess
import sys
from importlib import metadata

from packaging.requirements import Requirement


def needed(name: str, extras: frozenset[str] = frozenset()) -> set[str]:
    """Normalised names that a distribution leads to, itself included."""
    found, todo = set(), [(normalised(name), extras)]
    seen: set[tuple[str, frozenset[str]]] = set()
    while todo:
        one, wanted = todo.pop()
        if (one, wanted) in seen:
            continue
        seen.add((one, wanted))
        try:
            requires = metadata.requires(one) or []
        except metadata.PackageNotFoundError:
            continue  # for another platform
        found.add(one)
        for text in requires:
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in (wanted or {""})):
                todo.append((normalised(requirement.name), frozenset(requirement.extras)))
    return found


def normalised(name: str) -> str:
    """As PEP 503 has it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def main() -> int:
    """Uninstall, and say what."""
    installed = {normalised(d.metadata["Name"]) for d in metadata.distributions()}
    surplus = sorted(installed - needed("equigap") - {"pip"})
    print("not needed to run:", ", ".join(surplus))
    subprocess.run([sys.executable, "-m", "pip", "uninstall", "--quiet", "--yes", *surplus, "pip"], check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
