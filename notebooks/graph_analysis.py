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
# # The aspect graph of a real part, and what it says
#
# Which edges of a part are visible together, and from how much of the space around it? How does the
# view change on the way from one point to another? Four edges of NIST's test part CTC-01.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import networkx as nx

from aspectgraph import (
    build_aspect_graph,
    domain_path,
    plot_graph,
    read_entities,
    read_solid,
    richest_domains,
    stability,
)

EXAMPLES = Path("../examples") if Path("../examples").is_dir() else Path("examples")

solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
named = read_entities(EXAMPLES / "nist_ctc_01_entities.toml", solid)
wanted = {
    name: named[name]
    for name in ("plate_left", "slot_front", "boss_corner_front", "foot_back_left")
}
eag = build_aspect_graph(solid, wanted)
eag

# %% [markdown]
# ## The domains that see most

# %%
best = richest_domains(eag, 3)
for node in best:
    data = eag.graph.nodes[node]
    print(
        f"domain {node}: {', '.join(data['observable'])}; room for a ball of {data['clearance']:.0f} mm"
    )
assert len(eag.graph.nodes[best[0]]["observable"]) == max(
    len(o) for _, o in eag.graph.nodes(data="observable")
)

# %% [markdown]
# ## Stability by volume
#
# The share of the space from which a list of edges is observable: how probable it is that a camera put anywhere sees
# just these. Lists that only a sliver of space sees are of no use to a robot.

# %%
lists = stability(eag)
for one in lists:
    print(
        f"{one.share:7.2%}  {len(one.domains):3d} domains  {', '.join(one.observable) or 'nothing'}"
    )
assert abs(sum(one.share for one in lists) - 1) < 1e-9

fig, ax = plt.subplots(figsize=(8, 0.35 * len(lists) + 1), constrained_layout=True)
ax.barh(
    [", ".join(one.observable) or "nothing" for one in lists], [100 * one.share for one in lists]
)
ax.set(xlabel="share of the space around the part (%)")
ax.invert_yaxis()

# %% [markdown]
# ## The graph

# %%
plot_graph(eag)
plt.show()

# %% [markdown]
# ## From one view to another
#
# The way from a domain that sees nothing to the one that sees most, through as few partition surfaces as possible.

# %%
start = next(one for one in lists if not one.observable).domains[0]
for step in domain_path(eag, start, best[0]):
    print(
        f"into domain {step.domain}: + {', '.join(step.appear) or '-'}   - {', '.join(step.vanish) or '-'}"
    )

# %% [markdown]
# It is a networkx graph, so every other question can be asked as well: how many crossings lie between the two domains
# that are farthest apart?

# %%
print(nx.is_connected(eag.graph), nx.diameter(eag.graph) if nx.is_connected(eag.graph) else "")
