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
# # The entity-based aspect graph of a slotted block
#
# From where can each edge of a part be seen as a whole, and which edges can be seen together? This notebook builds
# the aspect graphs of C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection" (*J.
# Robotic Systems* 18, 2001), draws them, and compares them with the paper's Table I, Table II, Fig. 8 and the count
# of its section 3.4. The comparisons are assertions: if one failed, this notebook would stop there.
#
# **The solids are reconstructions.** The paper's drawings carry no dimensions. Ours have the shapes drawn and
# proportions for which the paper's lists come out; volumes, areas and viewpoints are ours alone. All lengths are in
# millimetres.
#
# ## What is computed
#
# * An **entity** is a straight edge $ab$ of the solid that someone wants to measure.
# * It is **observable** from a viewpoint $v$ if the open triangle $v\,a\,b$ misses the interior of the solid: to
#   measure an edge, all of it must be seen. Grazing a surface is allowed.
# * A **viewing domain** is a largest connected region of free space in which the list of observable entities stays
#   the same. Two domains may have the same list. The one from which nothing is observable counts too.
# * The **aspect graph** has a node per domain, and an edge between two domains that share a piece of surface.
#
# The surfaces between domains are planes, named as in the paper. **Type A** is the plane of a face next to an entity.
# **Type B** passes through an entity and a vertex, or through an end of an entity and another edge.

# %%
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt

from aspectgraph import (
    Solid,
    build_aspect_graph,
    complete_aspect_graph,
    plot_domains,
    plot_graph,
    plot_section,
    plot_solid,
    read_entities,
    read_solid,
)

EXAMPLES = Path("../examples") if Path("../examples").is_dir() else Path("examples")

slotted = read_solid(EXAMPLES / "slotted_block.off")
eag = build_aspect_graph(slotted, read_entities(EXAMPLES / "slotted_block_entities.toml", slotted))
print(
    f"{len(slotted.faces)} faces, {len(slotted.edges)} edges, entities {', '.join(eag.entity_names)}"
)
print(f"{len(eag.graph)} viewing domains, {eag.graph.number_of_edges()} adjacencies")

# %% [markdown]
# The part can be turned with the mouse. The entities are the two bottom edges of the slot (e1, e2) and the inner
# edges of the two steps (e3, e4), all along the height.

# %%
plot_solid(eag)

# %% [markdown]
# ## The domains in cross-section
#
# A cut at half the height. Every region carries its list; domains with the same list have the same colour here and in
# all pictures below. Solid lines are surfaces of type A, dashed ones of type B. e1 is seen from above and from the
# left, across the slot, until the slot's left rim hides it: that is the dashed line through e1 and the rim. No list
# is longer than two: e1 and e2 are seen together only from straight above the slot, and neither step is seen from
# there.

# %%
section = plot_section(eag)
plt.show()

# %% [markdown]
# ## The graph
#
# A circle is a domain (its size: the logarithm of the volume inside the workspace, dashed: the domain goes on beyond
# it), a line is a shared surface (its width: the logarithm of the area).

# %%
drawing = plot_graph(eag)
plt.show()

# %% [markdown]
# ### Side by side with Table I
#
# Each row of the paper's table must have its domain, and each domain its row.

# %%
TABLE_1 = [("e1", "e2"), ("e2",), ("e1",), ("e2", "e3"), ("e3",), ("e1", "e4"), ("e4",), ()]


def compare(eag, paper):
    """Print the paper's lists beside our domains and assert that they are the same, each as often."""
    nodes = {}
    for node, listed in eag.graph.nodes(data="observable"):
        nodes.setdefault(listed, []).append(node)
    print(
        f"{'paper':27s}{'ours':27s}{'node':>5s}{'neighbours':>14s}{'volume (mm³)':>15s}{'cells':>7s}{'rays':>6s}"
    )
    for listed in paper:
        node = nodes[listed].pop(0)
        data = eag.graph.nodes[node]
        ours, near = (
            " ".join(data["observable"]) or "none",
            ",".join(map(str, sorted(eag.graph[node]))),
        )
        row = f"{' '.join(listed) or 'none':27s}{ours:27s}{node:5d}{near:>14s}"
        print(f"{row}{data['volume']:15.4g}{data['n_cells']:7d}{data['n_rays']:6d}")
    assert Counter(paper) == Counter(listed for _, listed in eag.graph.nodes(data="observable"))
    print("The lists agree.")


compare(eag, TABLE_1)
assert (len(eag.graph), eag.graph.number_of_edges()) == (8, 11)

# %% [markdown]
# Each adjacency knows the surfaces that bound it, where they come from, and for which entity they matter. Between the
# domains {e1 e4} and {e4}, for instance, e1 disappears:

# %%
node_of = {listed: node for node, listed in eag.graph.nodes(data="observable")}
for surface in eag.graph.edges[node_of["e1", "e4"], node_of["e4",]]["surfaces"]:
    a, b, c, d = surface.plane
    source = {"faces": surface.faces, "edges": surface.edges, "vertices": surface.vertices}
    known = ", ".join(f"{key} {value}" for key, value in source.items() if value)
    print(
        f"type {surface.type}, {surface.entity}: {a:+.3f} x {b:+.3f} y {c:+.3f} z = {d:+.3f} mm, from {known}"
    )

# %% [markdown]
# ### In space
#
# Domains cut down to a box around the part; a click in the legend shows or hides one. The thin lines run from one
# viewpoint of each domain to the ends of what it observes.

# %%
plot_domains(eag, [node_of["e1", "e2"], node_of["e1", "e4"], node_of["e3",]])

# %% [markdown]
# ## How it is computed
#
# **Blocked sets.** Take an entity $ab$ and a convex piece $O$ of some face. A viewpoint does not see all of $ab$ past
# $O$ if it lies behind $O$ on a line from some point of the entity through $O$, that is, in
#
# $$B = \{\,q + t\,(q-p) : q\in O,\; p\in ab,\; t\ge 0\,\}.$$
#
# If the plane of $O$ cuts the entity, only the part in front of $O$ counts for $ab$; its new end
# lies in the plane of $O$. The entity is observable from the region where its own two faces do not
# hide it, minus the blocked sets of all pieces of the surface. No planes are listed in advance and
# no combinations of half-spaces are tried, as the paper does: $n$ planes have $2^n$ of those, and
# nearly all would be merged away again. A blocked set only cuts where something is still
# observable.
#
# **Every boundary is a plane of type A or B.** First, $B$ is convex. A sum $q_1 + t\,(q_2-p)$ with both $q$ in $O$ is
# itself in $B$: with $q = (q_1 + t\,q_2)/(1+t)$, which is in $O$, it is $q + t\,(q-p)$. So $B$ is the sum of $O$ and
# of the cone over $O - ab$, the differences of their points, and sums and cones of convex sets are convex.
#
# Second, consider a flat piece of the boundary of $B$, with outer normal $n$. If it is bounded, it
# is $O$ itself, and its plane is that of a face. Otherwise it contains a direction $q-p$ from an
# end $p$ of $ab$ to a corner $q$ of $O$. No direction of the cone leads out of $B$, so $n\cdot q'
# \le n\cdot p'$ for all $q'\in O$, $p'\in ab$, with equality for $q$ and $p$. So the plane
# separates $O$ from $ab$ and touches both. What it touches must span it: a corner of $O$ and the
# whole of $ab$, or an edge of $O$ and an end of $ab$. Both are type B, or type A where the plane is
# that of a face next to the entity. (Where the end is the new one in the plane of $O$, the plane
# through it and an edge of $O$ is that of $O$, a face. The seams where a face was cut into convex
# pieces bound nothing: the blocked sets on both sides meet there.)
#
# Unions, intersections and complements of such sets have no boundaries but theirs, so the same holds for the regions
# of entities and for viewing domains. The quadrics of **type C**, swept by lines that touch three skew edges, never
# bound a domain here. They are real for another question, *how much* of an edge is seen: its visible part vanishes
# where two other edges cross in front of it in the picture. The whole edge has ceased to be seen before that.
#
# **Exact.** Vertices are snapped once to an integer grid of about $2^{20}$ steps. Planes through
# three vertices then have integer coefficients, and a corner of a cell is named by three planes.
# There is only one question: on which side of a plane does a corner lie? The answer is the sign of
# a determinant of integers, computed without rounding. Parts are full of coplanar faces and planes
# through one common line; there, any tolerance would sometimes be wrong.
#
# **Simplified.** Cutting leaves many convex cells. Only the walls between observable and blocked ones matter, so each
# entity's region is rebuilt from these walls alone. The regions are then overlaid, the solid is taken out, and cells
# with equal lists that share a wall are merged into domains. Where snapping displaced
# vertices, domains thinner than that can account for are merged into the neighbour with which they share most, and
# counted.
#
# **Confirmed.** For every domain, rays are cast with Open3D from a viewpoint inside it to points along every entity.
# Rays are single precision; where they disagree with the list, exact arithmetic decides, and a true contradiction
# would be an error.

# %%
facts = eag.graph.graph
print(
    f"grid step {facts['grid_mm']:.3g} mm, largest displacement of a vertex {facts['snapping_mm']:.3g} mm"
)
print(f"{facts['n_slivers']} domains merged for being thinner than {facts['min_width_mm']:.3g} mm")
cells = sum(n for _, n in eag.graph.nodes(data="n_cells"))
print(f"{cells} convex cells in {len(eag.graph)} domains, confirmed by ray casting: ", end="")
print(f"{sum(ok for _, ok in eag.graph.nodes(data='confirmed'))} of {len(eag.graph)}")
assert all(ok for _, ok in eag.graph.nodes(data="confirmed"))
kinds = Counter(
    surface.type for *_, surfaces in eag.graph.edges(data="surfaces") for surface in surfaces
)
print(f"surfaces on the graph's edges by type: {dict(kinds)}")
assert set(kinds) <= {"A", "B"}

# %% [markdown]
# ## A block with two pockets: Table II
#
# Two pockets in faces that meet at right angles; in each, two edges of the rim that meet (e1, e2 and e4, e5) and the
# edge that goes into the pocket at their corner (e3 and e6).

# %%
block = read_solid(EXAMPLES / "two_pocket_block.off")
pockets = build_aspect_graph(
    block, read_entities(EXAMPLES / "two_pocket_block_entities.toml", block)
)
TABLE_2 = [
    ("e1", "e2", "e3"),
    ("e1", "e2"),
    ("e4", "e5", "e6"),
    ("e4", "e5"),
    ("e1", "e2", "e4", "e5"),
    ("e1", "e2", "e3", "e4", "e5", "e6"),
    ("e1", "e2", "e4", "e5", "e6"),
    ("e1", "e2", "e3", "e4", "e5"),
    (),
]
compare(pockets, TABLE_2)
assert (len(pockets.graph), pockets.graph.number_of_edges()) == (9, 13)

# %%
fig, axes = plt.subplots(1, 2, figsize=(13, 5.5), layout="constrained")
plot_section(pockets, ax=axes[0])
plot_graph(pockets, ax=axes[1])
plt.show()

# %%
plot_domains(pockets)

# %% [markdown]
# ## An L-block: 20 nodes for its step, 71 for everything
#
# Fig. 8 of the paper: of an L-block, only the two faces of the step matter, so only their seven edges are entities.
# The graph has 20 nodes. Unlike above, some lists belong to two domains that do not touch.

# %%
profile = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
n = len(profile)
vertices = [(x, y, 0) for x, y in profile] + [(x, y, 2) for x, y in profile]
sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
l_block = Solid(vertices, [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides], name="L-block")
# the sides at (3, 1)-(1, 1) and (1, 1)-(1, 2), after the bottom and the top
step_edges = [edge.id for edge in l_block.edges if {4, 5} & set(edge.faces)]
step = build_aspect_graph(l_block, step_edges)
n_lists = len({listed for _, listed in step.graph.nodes(data="observable")})
print(
    f"step: {len(step.graph)} nodes (paper: 20), {step.graph.number_of_edges()} adjacencies, {n_lists} lists"
)
assert (len(step.graph), step.graph.number_of_edges(), n_lists) == (20, 40, 13)

# %% [markdown]
# The *complete* aspect graph distinguishes every line drawing: which edges are visible, which are cut off, and by
# which other edge. It has 71 nodes, as section 3.4 of the paper says, and needs all planes through an edge and a
# vertex. (Type C does bound such drawings; these surfaces are left out here.) An entity-based graph leaves out what
# does not matter to the edges that shall be measured.

# %%
complete = complete_aspect_graph(l_block)
print(
    f"complete: {len(complete)} nodes (paper: 71), {complete.number_of_edges()} adjacencies, ",
    end="",
)
print(f"from {complete.graph['n_planes']} planes and {complete.graph['n_cells']} cells")
assert (len(complete), complete.number_of_edges()) == (71, 164)

# %%
fig, axes = plt.subplots(1, 2, figsize=(15, 7), layout="constrained")
plot_graph(step, ax=axes[0]).ax.set_title("the seven edges of the step: 20 domains")
seen = {node: str(k) for node, k in complete.nodes(data="n_visible")}
plot_graph(complete, ax=axes[1], labels=seen).ax.set_title(
    "complete: 71 domains (number: edges seen whole)"
)
plt.show()

# %%
plot_solid(step)
