"""Measured sheets in the documented layout: written by hand, read back, calibrated; and every error of the layout."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate import errors
from meshes import triangles
from studies.grid.generalise import generalise_steps, windows
from studies.grid.generalise.generalise_results import GeneraliseResults
from studies.grid.generalise.generalise_settings import MEASURED
from studies.grid.generalise.generalise_study import GENERALISE, measured
from studies.grid.generalise.report import page
from studies.importers import abbasi_sheets

MU, MARGIN = 0.4, 2.5
STRETCHES = np.linspace(1.0, 2.0, 6)
MAP = """
name = "{name}"
thickness_mm = 1.0
[points]
files = "{name}/frame_*.csv"
x = "x"
y = "y"
u = "u"
v = "v"
max_edge_mm = 12.0
[force]
file = "{name}/force.csv"
force = "force"
per_frame = true
[edges]
loaded = ["left", "right"]
free = ["holes"]
tolerance_mm = 0.01
[frames]
list = [1, 2, 3, 4, 5]
[noise]
displacement_std_mm = 0.01
force_std_relative = 0.001
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Two sheets of a neo-Hookean rubber in uniaxial tension, as tables, one to a stretch of 2, one to 1.6."""
    monkeypatch.setenv(abbasi_sheets.VARIABLE, str(tmp_path))
    folder = tmp_path / abbasi_sheets.FOLDER
    for name, most in (("UT", 2.0), ("PS", 1.6)):
        (folder / name).mkdir(parents=True)
        x, y = triangles(windows.seen(windows.specimen("UT"), MARGIN), n_nodes=150).points.T
        stretches = 1 + (STRETCHES - 1) * (most - 1)
        for k, s in enumerate(stretches):
            table = np.column_stack([x, y, (s - 1) * x, (s**-0.5 - 1) * y])
            np.savetxt(folder / name / f"frame_{k}.csv", table, delimiter=",", header="x,y,u,v", comments="")
        force = 30 * MU * (stretches - stretches**-2)
        np.savetxt(folder / name / "force.csv", force, header="force", comments="")
        (folder / f"{name}.toml").write_text(MAP.format(name=name))
    (folder / abbasi_sheets.MARGINS).write_text(f"UT = {MARGIN}\nPS = {MARGIN}\n")
    return folder


def test_a_sheet_is_read_with_its_margin(place):
    sheet = abbasi_sheets.sheet("UT")
    assert abbasi_sheets.names() == ("UT", "PS")
    assert sheet.provenance["margin_mm"] == MARGIN
    assert sheet.free_nodes.size == 0
    np.testing.assert_allclose(np.ptp(sheet.points, axis=0), [95.0, 25.0])
    assert sheet.loaded[1].force[-1, 0] == pytest.approx(30 * MU * (2 - 0.25))


@pytest.mark.slow
def test_the_study_runs_on_measured_sheets(place, tmp_path):
    """Forces of 30 mm and displacements of 25 mm: both sheets are predicted from one another, without a truth."""
    settings = replace(
        measured(GENERALISE.default, abbasi_sheets.names()), inputs=("I1",), sizes=((1,),), starts=2, as_width=False
    )
    assert settings.sets == ("UT", "PS", "UT+PS")
    for name in settings.specimens:
        generalise_steps.observe(tmp_path, settings, MEASURED, name)
    generalise_steps.states(tmp_path, settings, MEASURED)
    generalise_steps.calibrate(tmp_path, settings, MEASURED, "I1", "0")
    results = GeneraliseResults(tmp_path, settings)
    for one in results.chosen(MEASURED, 0):
        assert min(one.scores.values()) > 0.9999
        stress = one.predictions["equibiaxial"].stress
        assert stress[20] == pytest.approx(MU * (1.95 - 1.95**-5), rel=0.05)
    assert [section.heading for section in page(results).sections][1] == "measured"


def test_what_is_missing_is_said(place, monkeypatch):
    with pytest.raises(errors.DataNotFoundError, match=r"TTa.toml: no such column map; the specimens there are UT, PS"):
        abbasi_sheets.sheet("TTa")
    (place / abbasi_sheets.MARGINS).write_text("UT = -1.0\n")
    with pytest.raises(errors.ConfigError, match="UT = -1.0; give 0 or the width"):
        abbasi_sheets.sheet("UT")
    with pytest.raises(errors.ConfigError, match="PS = None"):
        abbasi_sheets.sheet("PS")
    (place / abbasi_sheets.MARGINS).write_text("UT 2.5\n")
    with pytest.raises(errors.ConfigError, match="no TOML"):
        abbasi_sheets.sheet("UT")
    (place / abbasi_sheets.MARGINS).unlink()
    with pytest.raises(errors.DataNotFoundError, match=r"margins.toml: no such file; write for each specimen"):
        abbasi_sheets.sheet("UT")
    (place / "PS.toml").unlink()
    with pytest.raises(errors.DataNotFoundError, match="at least two specimens"):
        abbasi_sheets.names()
    monkeypatch.delenv(abbasi_sheets.VARIABLE)
    with pytest.raises(errors.DataNotFoundError, match="no such folder in EQUIGAP_DATA"):
        abbasi_sheets.names()
