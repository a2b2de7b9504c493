"""Numbers behind the report of a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discoveries import sheet
from skip_network import neo_hooke

from calibrate.fitting.calibration import Options, calibrate
from studies.reports.calibration import figures
from studies.reports.calibration.fit_review import curve_points, review
from studies.reports.prediction.predicted_curves import calibrated_stretch


def test_a_point_of_a_curve_is_calibrated_up_to_the_states_near_its_mode():
    """Of a test that holds equi-biaxial tension to 1.2 and no pure shear."""
    ends = {"I1 near uniaxial": 6.0, "I1 near equi-biaxial": 2 * 1.2**2 + 1.2**-4, "I1 near pure shear": 3.0}
    known = neo_hooke()
    model = replace(known, calibrated_range=known.calibrated_range | {name: (3.0, end) for name, end in ends.items()})
    points = curve_points(model, (0.05, 0.25, 1.0, 1.25))
    for mode, calibrated in {"uniaxial": 3, "equibiaxial": 2, "pure_shear": 0}.items():
        own = [p for p in points if p["mode"] == mode]
        assert [p["calibrated"] for p in own] == [True] * calibrated + [False] * (4 - calibrated)
        assert all(p["calibrated"] == (p["stretch"] <= calibrated_stretch(model, mode) * (1 + 1e-9)) for p in own)


def test_the_loss_that_noise_alone_leaves_is_equations_minus_parameters():
    """Whatever the stiffness is corrected by after the fit."""
    found = calibrate(sheet(), Options(layers=(1,), starts=1))
    assert found.attenuation > 1
    (line,) = (
        one for one in figures.starts(review(found)).axes[0].lines if one.get_label() == "expected from the noise alone"
    )
    equations = np.isfinite(found.system.loads).sum()
    assert line.get_ydata()[0] == equations - found.model.architecture.n_parameters
