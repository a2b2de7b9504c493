"""What noise does to the 3D effect of thickness: one blind trial, clean and noisy, printed.

In: a seed of `studies.trials.blind_data`. Out: b fitted and hidden, mm^2, reduced chi-square, and the attenuation that the noise in the
signature brings, from clean and noisy signatures. Run: ``python benchmarks/thickness_noise.py [seed]``; half a minute.
"""

from __future__ import annotations

import sys
from dataclasses import replace


def main(seed: int) -> None:
    """Solve, fit clean and noisy, compare."""
    import numpy as np

    from calibrate.diagnosis import base_fit, weighted_fit
    from calibrate.diagnosis.problem import all_rows, signature
    from calibrate.effects.chain import Addition
    from calibrate.effects.finite_thickness import Thickness
    from studies.trials import blind_data, blind_solution

    trial = blind_data.draw(seed, Thickness.name)
    clean = blind_solution.clean_experiment(trial)
    noisy = blind_data.record(trial, clean)
    hidden = trial.effects[0].amplitudes["b"]
    for name, e in (("clean", replace(clean, noise=noisy.noise)), ("noisy", noisy)):
        problem, base = base_fit.prepare([e], [all_rows])
        fit = weighted_fit.fit_with_weights(problem, base.c, (Addition(Thickness(), (0.3 * hidden,), ()),))[1]
        b = fit.additions[0].amplitudes[0]
        chi = base.reduced_chi_square, fit.reduced_chi_square
        print(f"{name}: b {b:.3f} of {hidden:.3f} mm^2, reduced chi-square {chi[0]:.3g} -> {chi[1]:.3g}")
    chain = problem.parts[0].chain
    signatures = []
    for u in (clean.displacements, noisy.displacements):
        moved = chain.disturbed(u - np.asarray(chain.data.u))
        s = signature(problem, [moved], base.c, (Addition(Thickness(), (0.0,), ()),))[:, 0]
        signatures.append(s - base.columns @ (base.columns.T @ s))
    exact, seen = signatures
    print(f"attenuation: {float(exact @ seen) / float(seen @ seen):.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5043)
