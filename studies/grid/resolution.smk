# Resolution study: forward solution -> meshes -> Experiments -> calibrated cases.
# Run by `equigap resolution`; by hand: snakemake -s studies/resolution.smk --cores 2 --config folder=FOLDER
# (FOLDER must hold run.json). The report is written by `equigap resolution` from the cases.
import shlex
import sys
from pathlib import Path

from studies.grid.resolution_case import Settings, format_level

folder = Path(config["folder"])
settings = Settings.read(folder)
levels = [format_level(level) for level in settings.levels]
step = f"{shlex.quote(sys.executable)} -m studies.grid.resolution_case"

rule all:
    input:
        expand(f"{folder}/cases/{{level}}_{{seed}}.json", level=levels, seed=settings.noise_seeds),

rule forward:
    output: f"{folder}/solution.npz",
    resources: mem_mb=1500
    shell: step + " forward {folder:q}"

rule mesh:
    output: f"{folder}/mesh_{{level}}.npz",
    resources: mem_mb=500
    shell: step + " mesh {folder:q} {wildcards.level}"

rule observe:
    input:
        solution=f"{folder}/solution.npz",
        meshes=expand(f"{folder}/mesh_{{level}}.npz", level=levels),
    output: expand(f"{folder}/experiments/{{level}}_{{{{seed}}}}.npz", level=levels),
    resources: mem_mb=1500
    shell: step + " observe {folder:q} {wildcards.seed}"

rule case:
    input:
        experiment=f"{folder}/experiments/{{level}}_{{seed}}.npz",
        reference=f"{folder}/experiments/{levels[0]}_clean.npz",
    output: f"{folder}/cases/{{level}}_{{seed}}.json",
    resources: mem_mb=2500
    shell: step + " case {folder:q} {wildcards.level} {wildcards.seed}"
