"""The table of what each of several tests has for itself: only what is there and seen, with its probabilities."""

from dataclasses import replace

from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.effects.stiffness_gradient import StiffnessGradient
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from studies.reports.discovery.own_effects_table import alike, own_effects_record, own_effects_table, seen, stand_ins

GRADIENT = OwnEffect(
    StiffnessGradient(), ("a", "b"), 0.99, 0.0, (0.1, 0.1), ((0.2, 0.0), (0.01, 0.0)), ((0.02, 0.02),) * 2, 3.0
)
STRIP = OwnEffect(UnmeasuredStrip(), ("a",), 0.97, 0.0, (1.0,), ((0.3,),), ((0.05,),), 3.0)


def test_rows_are_amplitudes_that_are_seen():
    header, rows = own_effects_table((GRADIENT, STRIP), "MPa")
    assert header == ["effect", "amplitude", "prior", "a", "b", "P(each its own)", "P(alike)"]
    assert [row[:2] for row in rows] == [["stiffness gradient", "gx (1/extent)"], ["unmeasured strip", "w (mm)"]]
    assert rows[0][-2:] == ["0.990", "0.000"]
    assert rows[1][4] == "cannot be told"  # of a test that has no equation for it


def test_what_is_not_probable_has_no_row():
    unsure = replace(GRADIENT, own=0.5, common=0.1)
    assert own_effects_table((unsure,), "MPa")[1] == []
    assert alike((unsure,), "MPa") == seen((unsure,)) == []


def test_sentences_name_tests_and_common_amplitudes():
    common = replace(GRADIENT, own=0.01, common=0.99, values=((0.2, 0.0),) * 2)
    assert seen((GRADIENT, STRIP)) == ["stiffness gradient, unmeasured strip of a"]
    assert len(alike((common,), "MPa")) == 1
    assert alike((common,), "MPa")[0].startswith("stiffness gradient (gx = 0.2")
    assert alike((common,), "MPa")[0].endswith(" 1/extent)")
    assert "gy" not in alike((common,), "MPa")[0]


def test_what_no_specimen_could_have_is_named_of_none():
    """A gradient of 0.2 where a deviation is 0.05: it stands in for something else."""
    far = replace(GRADIENT, prior=(0.05, 0.05))
    assert stand_ins((far, STRIP)) == ["stiffness gradient"]
    assert stand_ins((GRADIENT, STRIP)) == []
    assert seen((far, STRIP)) == ["unmeasured strip of a"]
    assert alike((replace(far, own=0.01, common=0.99),), "MPa") == []
    assert len(own_effects_table((far,), "MPa")[1]) == 1


def test_the_record_has_every_number():
    (record,) = own_effects_record((GRADIENT,))
    assert record["tests"] == ["a", "b"]
    assert record["values"] == [[0.2, 0.0], [0.01, 0.0]]
    assert record["seen_in"] == ["a"]
