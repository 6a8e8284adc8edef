"""Principal components of regions of the mesh, fitted jointly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.linalg import eigh

from deformer.baselines._linear import LinearMethod
from deformer.baselines._linear_basis import LinearBasis
from deformer.baselines.pca import principal_components
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, IntArray, Mesh, farthest_points

# Number of landmarks, the vertices that are clustered; other vertices join the nearest landmark.
_LANDMARKS = 500
# Width of the affinity's geodesic factor, in units of the mesh's largest geodesic distance.
_AFFINITY_WIDTH = 0.2
# Candidate numbers of regions (at most K), and folds of the cross-validation that chooses one.
_REGIONS = (2, 4, 6, 9, 13, 18)
_FOLDS = 4
_RESTARTS = 10


@dataclass(frozen=True, eq=False)
class RegionBasis(LinearBasis):
    """Components with one region each; a shared vertex is the mean of its regions' predictions.

    Args:
        members: (R, V) bool, true where a vertex belongs to a region.
    """

    members: np.ndarray

    def encode(self, vertices: FloatArray) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3), of all regions jointly.

        Minimises the residual plus ‖S z‖², the disagreement of regions. Components are orthonormal
        within their region, so that the normal equations are (1 + Sᵀ S) z = Bᵀ (p − origin).
        """
        own = self.matrix * np.repeat(self.members.sum(0), 3)
        against = (vertices - self.origin).reshape(len(vertices), -1) @ own.T
        normal = np.eye(len(own)) + self.seams.T @ self.seams
        return np.asarray(np.linalg.solve(normal, against.T).T, dtype=np.float64)


class ClusteredPCA(LinearMethod):
    """Tena, De la Torre and Matthews, "Interactive Region-Based Linear 3D Face Models".

    SIGGRAPH 2011. Spectral clustering cuts the mesh into regions of vertices that are near and move
    together; regions share the vertices of the faces between them. Each region has its own
    principal components. One solve fits the codes of all regions; it penalises the disagreement of
    regions on shared vertices (weight 1 when all vertices are known, a weight chosen with the ridge
    for handles).

    This project's own choices, because the paper's are for faces:
    - the affinity of two vertices is (1 + correlation of their displacements) / 2 · exp(−(d/0.2)²),
      with their geodesic distance d in units of the largest one;
    - 500 vertices spread over the mesh are clustered, so that the matrix stays small; the others
      join the nearest;
    - the K components of largest variance are used, at least one of each region;
    - the number of regions is the one of 2, 4, 6, 9, 13, 18 (at most K) with the least error in a
      four-fold cross-validation.
    The paper's interface and its hard constraints are left out.

    Args:
        regions: number of regions; None chooses it.

    Raises:
        InputError: a number of regions below 1.
    """

    name: ClassVar[str] = "Clustered PCA"

    def __init__(self, regions: int | None = None) -> None:
        """Store the number of regions."""
        if regions is not None and regions < 1:
            raise InputError(f"regions: expected at least 1, got {regions}")
        self._regions = regions

    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> RegionBasis:
        """Basis of shapes (N, V, 3), with regions on the reference; `seed` is the clustering's."""
        if self._regions is not None:
            if self._regions > components:
                raise InputError(
                    f"components: expected at least one for each of {self._regions} regions, "
                    f"got {components}"
                )
            counts = [self._regions]
        else:
            counts = [count for count in _REGIONS if count <= components] or [1]
        segmentations = segment(vertices, reference, counts, seed)
        if len(segmentations) > 1:
            errors = [_unseen_error(vertices, m, components) for m in segmentations]
            segmentations = [segmentations[int(np.argmin(errors))]]
        return _region_basis(vertices, segmentations[0], components)


def segment(
    vertices: FloatArray, reference: Mesh, counts: list[int], seed: int
) -> list[np.ndarray]:
    """Segmentations of the mesh, each as members (R, V) bool that overlap by the faces in between.

    Args:
        vertices: (N, V, 3) shapes.
        reference: mesh whose geodesic distances enter the affinity.
        counts: numbers of regions, each at most V; there are fewer regions where the clustering
            finds fewer.
        seed: seed of the first landmark and of k-means.
    """
    geodesics = Geodesics(reference, cache_rows=_LANDMARKS)
    landmarks = farthest_points(geodesics, min(_LANDMARKS, vertices.shape[1]), seed)
    distance = np.array([geodesics.row(int(v)) for v in landmarks])
    moves = (
        (vertices - vertices.mean(0))[:, landmarks].transpose(1, 0, 2).reshape(len(landmarks), -1)
    )
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    moves = np.divide(moves, length, out=np.zeros_like(moves), where=length > 0)
    near = np.exp(-((distance[:, landmarks] / (_AFFINITY_WIDTH * (geodesics.extent or 1.0))) ** 2))
    affinity = (1 + moves @ moves.T) / 2 * (near + near.T) / 2
    vectors = _leading_vectors(affinity, max(counts))
    nearest = distance.argmin(0)
    members = []
    for count in counts:
        labels = _k_means(vectors[:, :count], seed)[nearest]
        members.append(_overlapping(labels, reference.faces))
    return members


def _leading_vectors(affinity: FloatArray, count: int) -> FloatArray:
    """Eigenvectors (L, R) of D^−½ A D^−½, largest first (Ng, Jordan and Weiss 2001)."""
    degree = affinity.sum(1)
    scaled = affinity / np.sqrt(degree[:, None] * degree)
    L = len(affinity)
    vectors = eigh(scaled, subset_by_index=(max(0, L - count), L - 1))[1]
    return vectors[:, ::-1]


def _k_means(vectors: FloatArray, seed: int) -> IntArray:
    """Labels (L,) 0…R−1 of normalised rows (L, R), from the best of several starts."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    rows = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    rng = np.random.default_rng(seed)
    best, lowest = np.zeros(len(rows), dtype=np.int64), np.inf
    for _ in range(_RESTARTS):
        centres, labels = kmeans2(rows, rows.shape[1], minit="++", rng=rng, missing="warn")
        spread = ((rows - centres[labels]) ** 2).sum()
        if spread < lowest:
            best, lowest = labels.astype(np.int64), spread
    return np.unique(best, return_inverse=True)[1].ravel()


def _overlapping(labels: IntArray, faces: IntArray) -> np.ndarray:
    """Members (R, V): the vertices of each label, and those that share a face with one."""
    members = np.zeros((labels.max() + 1, len(labels)), dtype=bool)
    members[labels, np.arange(len(labels))] = True
    for corner in range(3):
        for other in range(3):
            members[labels[faces[:, corner]], faces[:, other]] = True
    return members


def _region_basis(vertices: FloatArray, members: np.ndarray, count: int) -> RegionBasis:
    """Basis of the `count` largest principal components of regions (R, V), at least one of each."""
    mean = vertices.mean(0)
    centred = vertices - mean
    found = [principal_components(centred[:, m].reshape(len(centred), -1), count) for m in members]
    strength = np.array([values for values, _ in found])
    strength[:, 0] = np.inf  # selects the first of every region
    region, rank = np.unravel_index(
        np.argsort(-strength, axis=None, kind="stable")[:count], strength.shape
    )
    own = np.zeros((count, *mean.shape))
    for k, (r, j) in enumerate(zip(region, rank, strict=True)):
        own[k, members[r]] = found[r][1][j].reshape(-1, 3)
    shared = members.sum(0)
    return RegionBasis(mean, own / shared[:, None], _seams(own, region, members), members)


def _seams(own: FloatArray, region: IntArray, members: np.ndarray) -> FloatArray:
    """Seams S (K, K): ‖S z‖² = Σ ‖a region's prediction − mean prediction‖² over shared vertices.

    S is a square root of the K × K Gram matrix, in place of a row for every vertex and region.
    """
    at = np.flatnonzero(members.sum(0) > 1)
    mean = own[:, at] / members.sum(0)[at, None]
    gram = np.zeros((len(own), len(own)))
    for r in range(len(members)):
        difference = np.where(region[:, None, None] == r, own[:, at], 0.0) - mean
        rows = (difference * members[r, at, None]).reshape(len(own), -1)
        gram += rows @ rows.T
    values, vectors = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def _unseen_error(vertices: FloatArray, members: np.ndarray, count: int) -> float:
    """Cross-validated squared error of fits to all vertices of held-out shapes."""
    group = np.arange(len(vertices)) % min(_FOLDS, len(vertices))
    error = 0.0
    for g in range(group.max() + 1):
        basis = _region_basis(vertices[group != g], members, count)
        left = vertices[group == g]
        error += ((basis.decode(basis.project(left)) - left) ** 2).sum()
    return float(error)
