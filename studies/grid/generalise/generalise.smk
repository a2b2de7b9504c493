# The study of generalisation: forward solutions -> what the camera sees -> calibrations of all sets and sizes, a job
# for each truth and each set of invariants.
# Run by `equigap generalise`; by hand as grid.smk. `update`: what exists is complete and stays.
import shlex
import sys
from pathlib import Path

from studies.grid.generalise.generalise_settings import MEASURED, GeneraliseSettings

folder = Path(config["folder"])
settings = GeneraliseSettings.read(folder)
step = f"{shlex.quote(sys.executable)} -m studies.grid.generalise.generalise_steps"

wildcard_constraints:
    truth="|".join(settings.truths),
    specimen="|".join(settings.specimens),
    inputs="|".join(settings.inputs),

localrules: all

def clean(wildcards):
    return [settings.clean_path(folder, wildcards.truth, specimen) for specimen in settings.specimens]

rule all:
    input: [str(path) for path in settings.targets(folder)]

rule forward:
    output: f"{folder}/forward/{{truth}}_{{specimen}}.npz"
    priority: 100
    resources: mem_mb=1500
    shell: step + " forward {folder:q} {wildcards.truth} {wildcards.specimen}"

rule observe:
    input: lambda wildcards: [] if wildcards.truth == MEASURED else [f"{folder}/forward/{wildcards.truth}_{wildcards.specimen}.npz"]
    output: f"{folder}/clean/{{truth}}_{{specimen}}.npz"
    priority: 50
    resources: mem_mb=1000
    shell: step + " observe {folder:q} {wildcards.truth} {wildcards.specimen}"

rule states:
    input: clean
    output: f"{folder}/states/{{truth}}.npz"
    resources: mem_mb=1500
    shell: step + " states {folder:q} {wildcards.truth}"

rule calibrate:
    input: clean
    output: [update(f"{folder}/cases/{{truth}}_{seed}_{{inputs}}.json") for seed in settings.seeds]
    params: seeds=settings.seeds
    priority: lambda wildcards: 10 + len(wildcards.inputs)
    resources: mem_mb=2500
    shell: step + " calibrate {folder:q} {wildcards.truth} {wildcards.inputs} {params.seeds}"

rule width:
    input: clean
    output: f"{folder}/cases/{{truth}}_width.json"
    resources: mem_mb=2500
    shell: step + " width {folder:q} {wildcards.truth}"
