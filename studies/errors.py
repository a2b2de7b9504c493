"""Named errors of the studies: each message says what is wrong and what to do."""


class StudyError(Exception):
    """Base of every error of this package that a user can mend."""


class OutputFolderError(StudyError, RuntimeError):
    """The output folder belongs to something else, or to a run with other settings."""


class OutputWriteError(StudyError, OSError):
    """An output file or folder cannot be written: no permission, no space."""


class DamagedFileError(StudyError, ValueError):
    """A file of a study's folder cannot be read as what it was written as."""


class OptionError(StudyError, ValueError):
    """An unknown or impossible option on the command line or in a configuration file."""


class WorkflowError(StudyError, RuntimeError):
    """A job of a study's workflow failed."""


class DesignError(StudyError, ValueError):
    """A design file that cannot be read, or asks for what no specimen can do."""


class ExportError(StudyError, ValueError):
    """A model that an export target cannot carry, or an option that it does not have."""


class AlertError(StudyError, ValueError):
    """The registry of alerts cannot be read, or a sentence has no code or two."""
