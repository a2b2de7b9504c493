"""Named errors of the calibration: each message says what is wrong, where, and what to do."""


class EquigapError(Exception):
    """Base of every error that a user can mend."""


class ExperimentError(EquigapError, ValueError):
    """The Experiment as a whole does not make sense."""


class ImpossibleCorrectionError(ExperimentError):
    """Effects so large that what was measured, corrected for them, is no test."""


class MeshMismatchError(ExperimentError):
    """Arrays of an Experiment do not belong to the same mesh, increments or boundaries."""


class DegenerateMeshError(ExperimentError):
    """Inverted, degenerate or duplicated triangles or nodes."""


class InvalidDeformationError(ExperimentError):
    """The deformation gradient has det F <= 0, or displacements are not finite."""


class MissingForceError(ExperimentError):
    """No force was measured where one is needed."""


class ForceSignError(ExperimentError):
    """Internal power and external power have opposite signs."""


class TimeError(ExperimentError):
    """Time does not increase, or begins before the loading."""


class UnitsError(ExperimentError):
    """A magnitude that no experiment in N, mm, MPa, s has."""


class LostPointsError(ExperimentError):
    """Too many measured points failed, or they reach a loaded edge."""


class FileFormatError(EquigapError, ValueError):
    """A file cannot be read: names the file, the line and the remedy."""


class ConfigError(EquigapError, ValueError):
    """An unknown or impossible option."""


class DataNotFoundError(EquigapError, FileNotFoundError):
    """A data set is not at hand and cannot be fetched."""


class NoTwinError(EquigapError, RuntimeError):
    """A test that cannot be replayed by finite elements, so that nothing tells its discretisation error."""


class FitError(EquigapError, RuntimeError):
    """The optimisation did not reach a solution."""


class WeakStrainError(FitError):
    """The strain is so near its noise that the weights of a flexible model follow the noise."""


class ModelFileError(EquigapError, ValueError):
    """A model file is not what it claims to be."""


class DecimalCommaError(FileFormatError):
    """A number is written with a decimal comma."""


class UndecidedError(ConfigError):
    """The data do not say what has to be known; names the option that does."""
