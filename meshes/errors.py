"""Named errors of the meshes: each message says what is wrong and what to do."""


class MeshError(Exception):
    """Base of every error of this package."""


class SpecimenError(MeshError, ValueError):
    """Dimensions that make no specimen."""


class MeshQualityError(MeshError, RuntimeError):
    """The generated mesh misses the promised quality, area or number of nodes."""


class MeshDataError(MeshError, ValueError):
    """Arrays, names or a file that make no mesh."""


class MissingLibraryError(MeshError, RuntimeError):
    """gmsh, or a system library it needs, is not installed."""
