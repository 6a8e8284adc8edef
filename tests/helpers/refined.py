"""Models on finer meshes."""

from dataclasses import replace

import numpy as np

from deformer.geometry.mesh import Mesh, edges


def refined(model, times=1):
    """A model on its mesh with each face split into four, so many times, that decodes alike.

    The weights of a new vertex are the mean of those of its edge's ends. It encodes nothing.
    """
    for _ in range(times):
        mesh, C = model.closed.reference, model.weights.C
        V = len(mesh.vertices)
        pairs = np.sort(edges(mesh.faces), axis=1)
        number = {tuple(pair): V + n for n, pair in enumerate(pairs.tolist())}
        sides = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).tolist()
        m = np.array([[number[tuple(side)] for side in face] for face in sides])
        a, b, c = mesh.faces.T
        ab, bc, ca = m.T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.column_stack(corner) for corner in corners])
        vertices = np.concatenate([mesh.vertices, mesh.vertices[pairs].mean(axis=1)])
        # Rows of links come last.
        finer = np.concatenate([C[:V], C[pairs].mean(axis=1), C[V:]]).astype(C.dtype)
        model = replace(
            model,
            reference=Mesh(vertices, faces),
            weights=replace(model.weights, C=finer),
            seams=None,
            document=None,
        )
    return model
