"""Bulk modulus found in plane strain, over noise and seeds: the table of docs/method.md.

A plate with a hole in Arruda-Boyce rubber made compressible, biquadratic quads, seen by a camera of 1500 nodes. Prints a row for
each bulk modulus and noise. Run: ``python benchmarks/plane_strain.py`` (some minutes).
"""

from __future__ import annotations

import argparse


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--bulk-modulus", type=float, nargs="+", default=[2.0, 10.0, 50.0], metavar="MPA")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.02, 0.1], metavar="MM")
    args = parser.parse_args(words)
    import numpy as np

    from calibrate.errors import FitError
    from calibrate.fitting.calibration import Options, calibrate
    from forward.loading import Loading
    from forward.materials import ArrudaBoyce
    from forward.sheet.plane_stress import solve
    from meshes import quads, triangles
    from meshes.specimens import PlateWithHole
    from studies.synthetic.camera import Camera, GaussianField, observe

    specimen = PlateWithHole()
    loading = Loading.clamped(specimen.loaded, 20.0)
    mesh, points = quads(specimen, quarter=True, size_factor=1.5), triangles(specimen, n_nodes=1500)
    print("kappa, MPa; noise, mm; found: mean, standard deviation; stated deviation")
    for kappa in args.bulk_modulus:
        solution = solve(mesh, ArrudaBoyce(), loading, 6, bulk_modulus=kappa).mirrored()
        for noise in args.noise:
            camera = Camera(GaussianField(4.0, resolution=512), relative_noise=noise / 200)
            try:
                models = [
                    calibrate(observe(solution, points, camera, seed), Options(starts=3)).model
                    for seed in range(args.seeds)
                ]
            except FitError as error:
                print(f"{kappa:g}; {noise:g}; refused: {error}")
                continue
            found = np.array([(m.bulk_modulus, m.bulk_modulus_deviation) for m in models], float)
            spread = found[:, 0].std(ddof=1) if len(found) > 1 else float("nan")
            print(f"{kappa:g}; {noise:g}; {found[:, 0].mean():.4g}, {spread:.2g}; {found[:, 1].mean():.2g}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
