# A study: forward solutions (one for each specimen and thickness) and meshes -> clean Experiments -> calibrated cases.
# Run by `equigap resolution`, `thickness`, `sweep`; by hand: snakemake -s studies/grid/grid.smk --cores 2 --config folder=FOLDER
# (FOLDER must hold run.json), ranks=N for MPI; with `--sdm apptainer` and container=IMAGE every job runs in the image.
# The command writes the report. The longest jobs go first. `update`: what exists is complete and stays.
import shlex
import sys
from pathlib import Path

from studies.grid.axes import PLANE, Settings

folder = Path(config["folder"])
ranks = int(config.get("ranks", 1))
settings = Settings.read(folder)
image = config.get("container")
# a container has a Python of its own, in which equigap is installed
step = f"{'python' if image else shlex.quote(sys.executable)} -m studies.grid.steps"
# a scheduler takes `mpi` as the sign that the job starts its ranks itself, so it is there for several ranks only
launcher = Path(sys.executable).with_name("mpiexec")
parallel = {"mpi": str(launcher) if launcher.exists() and not image else "mpiexec"} if ranks > 1 else {}
start = "{resources.mpi} -n {resources.tasks} " if ranks > 1 else ""
kept = [f"{folder}/solids/{{specimen}}_{{thickness}}.npz"] if settings.keep_all else []
# one rule for all records, or one for each batch of them
batches = [["{noise}_{seed}"]] if settings.batch == 1 else settings.batches()

if image:

    container: image


wildcard_constraints:
    specimen="|".join(settings.specimens),
    thickness=r"[0-9][0-9.e+-]*",
    surface="|".join(settings.thicknesses),
    resolution="|".join(settings.resolutions),
    noise=r"[0-9.e+-]+",
    seed=r"[0-9]+|clean",

localrules: all

rule all:
    input: [str(path) for path in settings.targets(folder)]

rule plane:
    output: f"{folder}/forward/{{specimen}}_{PLANE}.npz",
    priority: 10000
    resources: mem_mb=1500
    shell: step + f" forward {{folder:q}} {{wildcards.specimen}} {PLANE}"

rule solid:
    output: f"{folder}/forward/{{specimen}}_{{thickness}}.npz", *kept
    priority: lambda wildcards: 10 + float(wildcards.thickness)
    threads: ranks
    resources:
        mem_mb=settings.solid_memory(ranks),
        tasks=ranks,
        cpus_per_task=1,
        **parallel,
    shell: start + step + " forward {folder:q} {wildcards.specimen} {wildcards.thickness}"

rule epsilon:
    input:
        plane=f"{folder}/forward/{{specimen}}_{PLANE}.npz",
        solid=f"{folder}/solids/{{specimen}}_{{thickness}}.npz",
    output: f"{folder}/epsilon/{{specimen}}_{{thickness}}.npz",
    resources: mem_mb=1500
    shell: step + " epsilon {folder:q} {wildcards.specimen} {wildcards.thickness}"

rule states:
    input: f"{folder}/forward/{{specimen}}_{PLANE}.npz",
    output: f"{folder}/states/{{specimen}}.npz",
    resources: mem_mb=1000
    shell: step + " states {folder:q} {wildcards.specimen}"

rule mesh:
    output: f"{folder}/meshes/{{specimen}}_{{resolution}}.npz",
    priority: 5
    resources: mem_mb=500
    shell: step + " mesh {folder:q} {wildcards.specimen} {wildcards.resolution}"

rule observe:
    input:
        solution=f"{folder}/forward/{{specimen}}_{{surface}}.npz",
        mesh=f"{folder}/meshes/{{specimen}}_{settings.resolutions[0]}.npz",
    output:
        experiment=f"{folder}/clean/{{specimen}}_{{surface}}.npz",
        range=f"{folder}/clean/{{specimen}}_{{surface}}.json",
    priority: 5
    resources: mem_mb=1500
    shell: step + " observe {folder:q} {wildcards.specimen} {wildcards.surface}"

for number, batch in enumerate(batches):

    rule:
        name: "fit" if len(batches) == 1 else f"fit_{number}"
        input:
            experiment=f"{folder}/clean/{{specimen}}_{{surface}}.npz",
            range=f"{folder}/clean/{{specimen}}_{PLANE if settings.plane_reference else '{surface}'}.json",
            states=f"{folder}/states/{{specimen}}.npz" if settings.plane_reference else [],
            mesh=f"{folder}/meshes/{{specimen}}_{{resolution}}.npz",
        output: [update(f"{folder}/cases/{{specimen}}/{{surface}}_{{resolution}}_{record}.json") for record in batch],
        params: records=batch
        priority: 2
        resources: mem_mb=settings.fit_memory
        shell:
            step + " fit {folder:q} {wildcards.specimen} {wildcards.surface} {wildcards.resolution} {params.records}"
