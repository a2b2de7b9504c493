"""Check a machine before anything long starts: names what is missing and the command that installs it.

Standard library only. Exit status 1 when something is missing. `--packages` prints only the Debian packages that
are missing; `--uv` says that virtual environments are made by uv, which does not need Python's own venv module.
"""

import ctypes
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile

# shared library -> Debian package: what the gmsh and vtk wheels link to and do not bring along
LIBRARIES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1",
    "libXcursor.so.1": "libxcursor1",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
    "libstdc++.so.6": "libstdc++6",
    "libz.so.1": "zlib1g",
}
GIGABYTES = 4  # of a fresh .venv, with some room for caches
Finding = tuple[str, list[str]]


def problems(uv: bool = False) -> list[Finding]:
    """What is wrong, in words, each with the Debian packages that mend it."""
    found = [*platform_problems(), *compiler_problems(), *library_problems()]
    found += [] if uv else venv_problems()
    return found + disk_problems()


def platform_problems() -> list[Finding]:
    found: list[Finding] = []
    if sys.platform != "linux" or platform.machine() != "x86_64":
        text = f"{sys.platform} {platform.machine()}: DOLFINx comes for Linux x86-64 only; use the container"
        found.append((text, []))
    libc, version = platform.libc_ver()
    if libc != "glibc" or tuple(map(int, version.split(".")[:2])) < (2, 34):
        text = f"{libc or 'C library'} {version}: glibc 2.34 is needed (Debian 12, Ubuntu 22.04); use the container"
        found.append((text, []))
    if not (3, 12) <= sys.version_info[:2] < (3, 15):
        found.append((f"Python {platform.python_version()}: 3.12, 3.13 or 3.14 is needed", []))
    return found


def compiler_problems() -> list[Finding]:
    """The finite-element forms are compiled at run time, as extension modules: this needs Python.h as well."""
    # setuptools calls what Python was built with, cc or gcc
    compiler = next((path for path in map(shutil.which, ("gcc", "cc")) if path), None)
    if compiler is None:
        return [("no C compiler (gcc), with which DOLFINx compiles its forms", ["gcc", "libc6-dev"])]
    if not compiles(compiler, "#include <math.h>\n#include <stdio.h>\n"):
        return [(f"{compiler} finds no C headers", ["libc6-dev"])]
    include = sysconfig.get_path("include")
    if not compiles(compiler, "#include <Python.h>\n", include, sysconfig.get_path("platinclude")):
        text = f"no Python.h in {include}, with which DOLFINx compiles its forms"
        return [(text, [f"python{sys.version_info[0]}.{sys.version_info[1]}-dev"])]
    return []


def compiles(compiler: str, source: str, *include: str) -> bool:
    """Whether a C source passes the compiler."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "check.c")
        with open(path, "w") as file:
            file.write(source)
        options = [f"-I{place}" for place in include]
        done = subprocess.run([compiler, *options, "-fsyntax-only", path], capture_output=True, check=False)
    return done.returncode == 0


def library_problems() -> list[Finding]:
    missing = [name for name in LIBRARIES if not loads(name)]
    if not missing:
        return []
    return [("no " + ", ".join(missing) + " for gmsh and vtk", [LIBRARIES[name] for name in missing])]


def loads(name: str) -> bool:
    """Whether the loader finds a shared library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def venv_problems() -> list[Finding]:
    if importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip"):
        return []
    package = f"python{sys.version_info[0]}.{sys.version_info[1]}-venv"
    return [(f"{sys.executable} cannot make virtual environments", [package])]


def disk_problems() -> list[Finding]:
    if os.path.isdir(".venv"):
        return []
    free = shutil.disk_usage(".").free / 1e9
    if free >= GIGABYTES:
        return []
    return [(f"{free:.1f} GB free on this disk; the packages need {GIGABYTES}: free some space", [])]


def main(arguments: list[str]) -> int:
    """Print what is wrong; with `--packages`, only the Debian packages."""
    found = problems("--uv" in arguments)
    packages = " ".join(dict.fromkeys(package for _, names in found for package in names))
    if "--packages" in arguments:
        print(packages)
        return 0
    for text, _ in found:
        print(f"equigap: error: {text}", file=sys.stderr)
    if packages:
        print(f"equigap: on Debian or Ubuntu, as root: apt-get install -y {packages}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
