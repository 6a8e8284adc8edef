"""Links between the connected components of a mesh: a tree that connects its pieces.

The surface of an eye is not connected to that of the head, and yet it moves with it. A link is an
edge between two components that are near each other; together they form the minimum spanning tree
of the components under the distance between their nearest vertices.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.spatial import KDTree


def spanning_links(vertices: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Links (B, 2) between B + 1 connected components, by Prim's algorithm.

    Args:
        vertices: (V, 3) positions.
        labels: (V,) component of each vertex, 0…B.

    Returns:
        In each row a vertex and the vertex of the parent component nearest to it. The component
        with the most vertices is the root; a parent's own link comes before those of its children.
    """
    sizes = np.bincount(labels)
    links = np.empty((len(sizes) - 1, 2), dtype=np.int64)
    if len(links) == 0:
        return links
    # Most meshes have one component and never need this import.
    from scipy.spatial import KDTree

    starts = np.append(0, np.cumsum(sizes))
    order = np.argsort(labels, kind="stable")
    members = np.split(order, starts[1:-1])
    sorted_vertices = vertices[order]
    low = np.minimum.reduceat(sorted_vertices, starts[:-1])
    high = np.maximum.reduceat(sorted_vertices, starts[:-1])
    trees: dict[int, KDTree] = {}

    def nearest(points: int, component: int, bound: float) -> tuple[float, int, int]:
        """Least distance below `bound` from a component's vertices to another, and the vertices."""
        if component not in trees:
            trees[component] = KDTree(vertices[members[component]])
        query = trees[component].query(vertices[members[points]], distance_upper_bound=bound)
        distance, found = np.asarray(query[0]), np.asarray(query[1])
        best = int(np.argmin(distance))
        if not np.isfinite(distance[best]):
            return np.inf, -1, -1
        return (
            float(distance[best]),
            int(members[points][best]),
            int(members[component][found[best]]),
        )

    root = int(sizes.argmax())
    waiting = np.ones(len(sizes), dtype=bool)
    waiting[root] = False
    distances = np.full(len(sizes), np.inf)
    ends = np.empty((len(sizes), 2), dtype=np.int64)
    added = root
    for n in range(len(links)):
        gap = np.maximum(np.maximum(low - high[added], low[added] - high), 0.0)
        apart = np.linalg.norm(gap, axis=1)
        for c in np.flatnonzero(waiting & (apart < distances)).tolist():
            if sizes[c] <= sizes[added]:
                distance, own, other = nearest(c, added, distances[c])
            else:
                distance, other, own = nearest(added, c, distances[c])
            if distance < distances[c]:
                distances[c], ends[c] = distance, (own, other)
        added = int(np.where(waiting, distances, np.inf).argmin())
        waiting[added] = False
        links[n] = ends[added]
    return links
