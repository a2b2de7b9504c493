# Thickness study: 2D and 3D solutions -> epsilon, Experiments -> calibrated cases.
# Run by `equigap thickness`; by hand: snakemake -s studies/thickness.smk --cores 2 --config folder=FOLDER
# (FOLDER must hold run.json), ranks=N for MPI. The report is written by `equigap thickness` from the files.
# The longest jobs go first. `update`: what exists is complete and stays when a job is taken up again.
import shlex
import sys
from pathlib import Path

from studies.grid.thickness_case import Settings, solid_memory, targets

folder = Path(config["folder"])
ranks = int(config.get("ranks", 1))
settings = Settings.read(folder)
seeds = settings.noise_seeds
step = f"{shlex.quote(sys.executable)} -m studies.grid.thickness_case"
# a scheduler takes `mpi` as the sign that the job starts its ranks itself, so it is there for several ranks only
launcher = Path(sys.executable).with_name("mpiexec")
parallel = {"mpi": str(launcher) if launcher.exists() else "mpiexec"} if ranks > 1 else {}
start = "{resources.mpi} -n {resources.tasks} " if ranks > 1 else ""

wildcard_constraints:
    thickness=r"[0-9][0-9.e+-]*",
    condition=r"plane|[0-9][0-9.e+-]*",

rule all:
    input: [str(path) for path in targets(folder, settings)]

rule plane:
    output: f"{folder}/plane.npz",
    priority: 10000
    resources: mem_mb=1500
    shell: step + " plane {folder:q}"

rule mesh:
    output: f"{folder}/mesh.npz",
    priority: 1
    resources: mem_mb=500
    shell: step + " mesh {folder:q}"

rule states:
    input: f"{folder}/plane.npz",
    output: f"{folder}/states.npz",
    resources: mem_mb=1000
    shell: step + " states {folder:q}"

rule solid:
    input: f"{folder}/plane.npz",
    output: f"{folder}/solid_{{thickness}}.npz",
    priority: lambda wildcards: 10 + float(wildcards.thickness)
    threads: ranks
    resources:
        mem_mb=solid_memory(settings, ranks),
        tasks=ranks,
        cpus_per_task=1,
        **parallel,
    shell: start + step + " solid {folder:q} {wildcards.thickness}"

rule epsilon:
    input:
        plane=f"{folder}/plane.npz",
        solid=f"{folder}/solid_{{thickness}}.npz",
    output: f"{folder}/epsilon_{{thickness}}.npz",
    resources: mem_mb=1500
    shell: step + " epsilon {folder:q} {wildcards.thickness}"

rule observe:
    input:
        solution=lambda w: f"{folder}/plane.npz" if w.condition == "plane" else f"{folder}/solid_{w.condition}.npz",
        mesh=f"{folder}/mesh.npz",
    output: [update(f"{folder}/experiments/{{condition}}_{seed}.npz") for seed in seeds],
    priority: 5
    resources: mem_mb=1500
    shell: step + " observe {folder:q} {wildcards.condition} {seeds}"

for number, batch in enumerate(settings.batches):

    rule:
        name: f"case_{number}"
        input:
            experiments=[f"{folder}/experiments/{{condition}}_{seed}.npz" for seed in batch],
            reference=f"{folder}/experiments/plane_clean.npz",
            states=f"{folder}/states.npz",
        output: [update(f"{folder}/cases/{{condition}}_{seed}.json") for seed in batch],
        params: batch=batch
        priority: 2
        resources: mem_mb=2500
        shell: step + " case {folder:q} {wildcards.condition} {params.batch}"
