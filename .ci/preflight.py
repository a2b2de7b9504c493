"""Check a machine before anything long starts: names what is missing and the command that installs it.

Standard library only. Exit status 1 when something is missing.
"""

import ctypes.util
import os
import platform
import shutil
import sys

# shared library -> Debian package; what the gmsh and vtk wheels link to and do not bring along
LIBRARIES = {
    "GLU": "libglu1-mesa",
    "GL": "libgl1",
    "EGL": "libegl1",
    "X11": "libx11-6",
    "Xrender": "libxrender1",
    "Xcursor": "libxcursor1",
    "Xfixes": "libxfixes3",
    "Xft": "libxft2",
    "Xinerama": "libxinerama1",
    "Xext": "libxext6",
    "fontconfig": "libfontconfig1",
    "gomp": "libgomp1",
}


def problems() -> tuple[list[str], list[str]]:
    """What is wrong, in words, and the Debian packages that would mend it."""
    wrong, packages = [], []
    if sys.platform != "linux" or platform.machine() != "x86_64":
        wrong.append(f"{sys.platform} {platform.machine()}: DOLFINx comes for Linux x86-64 only; use the container")
    libc, version = platform.libc_ver()
    if libc == "glibc" and tuple(map(int, version.split(".")[:2])) < (2, 34):
        wrong.append(f"glibc {version} is too old, 2.34 is needed (Debian 12, Ubuntu 22.04); use the container")
    if not (shutil.which("cc") or shutil.which("gcc")):
        wrong.append("no C compiler: DOLFINx compiles its forms with gcc")
        packages += ["gcc", "libc6-dev"]
    if os.path.basename(sys.prefix) != ".venv":
        try:
            import ensurepip  # noqa: F401
        except ImportError:
            wrong.append("Python has no venv module")
            packages.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv")
    missing = {name: package for name, package in LIBRARIES.items() if not find_library(name)}
    if missing:
        wrong.append("shared libraries missing (gmsh, vtk): " + ", ".join(f"lib{name}" for name in missing))
        packages += missing.values()
    return wrong, packages


def find_library(name: str) -> bool:
    """Whether the loader finds a shared library, with or without ldconfig and compiler."""
    if ctypes.util.find_library(name):
        return True
    folders = ["/lib/x86_64-linux-gnu", "/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/lib64", "/usr/lib", "/usr/local/lib"]
    folders += os.environ.get("LD_LIBRARY_PATH", "").split(":")
    return any(
        entry.startswith(f"lib{name}.so") for folder in folders if os.path.isdir(folder) for entry in os.listdir(folder)
    )


def main() -> int:
    """Print what is wrong; with `--packages`, only the Debian packages."""
    wrong, packages = problems()
    if "--packages" in sys.argv:
        print(" ".join(packages))
        return 0
    for line in wrong:
        print(f"equigap: {line}", file=sys.stderr)
    if packages:
        print(f"equigap: on Debian or Ubuntu, as root: apt-get install -y {' '.join(packages)}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
