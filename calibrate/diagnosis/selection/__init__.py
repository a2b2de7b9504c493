"""Which effects are added to a base model: tests, comparison of fits, data held out, verdict."""

from calibrate.diagnosis.selection.loop import close_loop
from calibrate.diagnosis.selection.rounds import Discovery, Verdict
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds

__all__ = ["DEFAULT", "Discovery", "Thresholds", "Verdict", "close_loop"]
