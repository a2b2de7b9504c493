# Sweep: forward solutions (one for each specimen and thickness) and meshes -> clean Experiments -> calibrated cases -> report.
# Run by `equigap sweep`; by hand: snakemake -s studies/sweep.smk --cores 2 --config folder=FOLDER
# (FOLDER must hold run.json); with `--sdm apptainer` and container=IMAGE in the config, every job runs in the image.
# The longest jobs go first.
import shlex
import sys
from pathlib import Path

from studies.grid.sweep_case import PLANE, Settings, memory, targets

folder = Path(config["folder"])
settings = Settings.read(folder)
image = config.get("container")
# a container has a Python of its own, in which equigap is installed
step = f"{'python' if image else shlex.quote(sys.executable)} -m studies.grid.sweep_case"

if image:

    container: image


wildcard_constraints:
    specimen="|".join(settings.specimens),
    thickness="|".join(settings.thicknesses),
    resolution="|".join(settings.resolutions),
    noise=r"[0-9.e+-]+",
    seed=r"[0-9]+|clean",

localrules: all

rule all:
    input: [str(path) for path in targets(folder, settings)]

rule forward:
    output: f"{folder}/forward/{{specimen}}_{{thickness}}.npz",
    priority: lambda wildcards: 10 + (0 if wildcards.thickness == PLANE else float(wildcards.thickness))
    resources: mem_mb=lambda wildcards: memory(settings, wildcards.thickness)
    shell: step + " forward {folder:q} {wildcards.specimen} {wildcards.thickness}"

rule mesh:
    output: f"{folder}/meshes/{{specimen}}_{{resolution}}.npz",
    priority: 5
    resources: mem_mb=500
    shell: step + " mesh {folder:q} {wildcards.specimen} {wildcards.resolution}"

rule observe:
    input:
        solution=f"{folder}/forward/{{specimen}}_{{thickness}}.npz",
        mesh=f"{folder}/meshes/{{specimen}}_{settings.resolutions[0]}.npz",
    output:
        experiment=f"{folder}/clean/{{specimen}}_{{thickness}}.npz",
        range=f"{folder}/clean/{{specimen}}_{{thickness}}.json",
    priority: 5
    resources: mem_mb=1500
    shell: step + " observe {folder:q} {wildcards.specimen} {wildcards.thickness}"

rule case:
    input:
        experiment=f"{folder}/clean/{{specimen}}_{{thickness}}.npz",
        range=f"{folder}/clean/{{specimen}}_{{thickness}}.json",
        mesh=f"{folder}/meshes/{{specimen}}_{{resolution}}.npz",
    output: f"{folder}/cases/{{specimen}}/{{thickness}}_{{resolution}}_{{noise}}_{{seed}}.json",
    resources: mem_mb=1500
    shell:
        step + " case {folder:q} {wildcards.specimen} {wildcards.thickness} {wildcards.resolution}"
        " {wildcards.noise} {wildcards.seed}"

rule collect:
    input: [str(case.path(folder)) for case in settings.cases],
    output: f"{folder}/report.html",
    resources: mem_mb=1500
    shell: step + " collect {folder:q}"
