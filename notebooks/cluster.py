# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # On a cluster with Dask
#
# A plan can be divided among machines: the visible regions of the entities, the search for poses, the proof of the
# bound, the simulation. Anything with the interface of `concurrent.futures.Executor` will do; Dask has one. Here
# scheduler and workers run on this machine; on a cluster, give `Client` the address of the scheduler.

# %%
import time
from pathlib import Path

from distributed import Client

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
# Each worker loads the compiled code first, which takes seconds, so that such a small request gains nothing. Parts with
# dozens of entities do.

# %%
with Client(n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
    begin = time.perf_counter()
    together = plan_inspection(*request, effort=Effort.named("quick"), executor=client.get_executor())
    print(f"{time.perf_counter() - begin:.1f} s on {len(client.scheduler_info()['workers'])} workers")
together

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
# * `state=` (or `--resume`) keeps results on disk: a plan goes on after a cluster went away.
