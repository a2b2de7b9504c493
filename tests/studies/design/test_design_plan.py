"""The design file: the default one, and named errors that say where and what."""

from pathlib import Path

import pytest

from studies.commands.design import default_file
from studies.design.design_plan import Plan, checked, read_plan
from studies.errors import DesignError

PLAIN = {"specimen": [{"kind": "UT"}]}
SOUGHT = {"kind": "UT", "between": {"half_width": [10.0, 20.0]}}


def test_the_default_file_states_the_defaults():
    found = read_plan(default_file())
    plain = checked(PLAIN, "plain")
    for name in Plan.model_fields:
        if name not in ("specimen", "optimise"):
            assert getattr(found, name) == getattr(plain, name), name


def test_the_page_shows_the_default_file():
    root = Path(__file__).parents[3]
    assert default_file().read_text() in (root / "docs" / "design.md").read_text()
    assert read_plan(root / "docs" / "design" / "cross_pattern.toml").optimise is not None


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"machine": {"axis": 1}}, "machine.axis: unknown key; did you mean axes"),
        ({"machine": {"axes": 3}}, "machine.axes"),
        ({"sheet": {"largest_stretch": 0.5}}, "sheet.largest_stretch"),
        ({"law": {"material": "rubber"}}, "'rubber' is unknown"),
        ({"stretches": {"biaxial": 1.5}}, "biaxial = 1.5"),
        ({"specimen": [{"kind": "cros"}]}, "did you mean cross"),
        ({"specimen": [{"kind": "UT"}, {"kind": "UT"}]}, "'UT' is there twice"),
        (
            {"specimen": [{"kind": "UT", "name": "sheet 1"}, {"kind": "PS", "name": "sheet_1"}]},
            "'sheet_1' would have the files of 'sheet 1'",
        ),
        ({"specimen": [{"kind": "UT", "name": "optimised"}], "optimise": SOUGHT}, "the files of the result of"),
        ({"stretches": {}}, "stretches: there is none"),
        ({"validation": {"truth": "carol"}}, "\\[validation\\] truth: material 'carol' is unknown"),
        ({"specimen": []}, "no \\[\\[specimen\\]\\]"),
        ({"specimen": [{"kind": "cross", "dimensions": {"half_width": -3.0}}]}, "half_width"),
        ({"optimise": {"kind": "UT", "between": {"half_width": [20.0, 10.0]}}}, "20 is not below 10"),
    ],
)
def test_what_is_refused(changed, says):
    with pytest.raises(DesignError, match=f"file.toml: .*{says}|{says}"):
        checked({**PLAIN, **changed}, "file.toml")


def test_no_file_and_no_toml(tmp_path):
    with pytest.raises(DesignError, match="name a design file"):
        read_plan(tmp_path / "absent.toml")
    (tmp_path / "bad.toml").write_text("[machine")
    with pytest.raises(DesignError, match="no valid TOML"):
        read_plan(tmp_path / "bad.toml")
