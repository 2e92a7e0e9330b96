# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # On a cluster with Dask
#
# A plan can be divided among machines: the visible regions of the entities, the search for poses,
# the proof of the bound, the simulation. Any `concurrent.futures.Executor` works, and Dask has one.
# Here, scheduler and workers run on this machine. On a cluster, give `Client` the address of the
# scheduler.

# %%
import time
from pathlib import Path

import matplotlib.pyplot as plt
from distributed import Client, get_task_stream

from aspectgraph import read_solid
from planner import Camera, Effort, PoseUncertainty, plan_inspection

EXAMPLES = Path("../examples") if Path("../examples").is_dir() else Path("examples")

block = read_solid(EXAMPLES / "two_pocket_block.off")
entities = {f"rim {k}": k for k in (8, 9, 10, 11, 24, 25, 26, 27)}
request = (
    block,
    entities,
    Camera.named("basler-acA2440-20gm-8mm"),
    PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
)

# %% [markdown]
# ## Alone

# %%
begin = time.perf_counter()
alone = plan_inspection(*request, effort=Effort.named("quick"))
print(f"{time.perf_counter() - begin:.1f} s")
alone

# %% [markdown]
# ## Together
#
# Each worker first loads the compiled code, which takes seconds. So this small request gains
# nothing, but parts with dozens of entities do.

# %%
with (
    Client(n_workers=2, threads_per_worker=1, dashboard_address=":0") as client,
    get_task_stream(client=client) as tasks,
):
    begin = time.perf_counter()
    together = plan_inspection(
        *request, effort=Effort.named("quick"), executor=client.get_executor()
    )
    print(
        f"{time.perf_counter() - begin:.1f} s on {len(client.scheduler_info()['workers'])} workers"
    )
together

# %% [markdown]
# Which worker did what, and when: a bar is a piece of work, coloured by the function that did it.
# Between them the client chooses the next work.

# %%
done = [
    (one["key"].rpartition("-")[0].lstrip("_"), one["worker"], *one["startstops"])
    for one in tasks.data
]
first = min(times["start"] for _, _, *steps in done for times in steps)
workers, kinds = (
    sorted({worker for _, worker, *_ in done}),
    list(dict.fromkeys(kind for kind, *_ in done)),
)
fig, ax = plt.subplots(figsize=(10, 2.2), layout="constrained")
for k, kind in enumerate(kinds):
    for row, worker in enumerate(workers):
        steps = [one for name, at, *steps in done if (name, at) == (kind, worker) for one in steps]
        bars = [
            (one["start"] - first, one["stop"] - one["start"])
            for one in steps
            if one["action"] == "compute"
        ]
        ax.broken_barh(
            bars,
            (row - 0.35, 0.7),
            color=f"C{k}",
            ec="white",
            lw=0.5,
            label=kind if row == 0 else None,
        )
ax.set(
    xlabel="seconds",
    yticks=range(len(workers)),
    yticklabels=[f"worker {k + 1}" for k in range(len(workers))],
)
fig.legend(loc="outside upper center", ncols=len(kinds), frameon=False)
plt.show()
assert len(workers) == 2

# %% [markdown]
# ## The same, to the last bit
#
# How the work is divided changes nothing: not the settings, not the bound, not a digit.

# %%
assert together == alone
assert together.to_dict() == alone.to_dict()

# %% [markdown]
# ## What to mind
#
# * Every worker needs the same version of the program, and of numpy.
# * `NUMBA_CACHE_DIR` on a shared disk lets workers compile once.
# * `state=` (or `--resume`) keeps results on disk. A plan continues after the cluster has stopped.
