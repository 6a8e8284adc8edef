"""A rectangle of cloth: its grid, its constraints, and extended position-based dynamics (XPBD).

Macklin, Müller, Chentanez, "XPBD" (2016), with many small steps of one iteration each (Macklin et
al., "Small Steps in Physics Simulation", 2019): a step predicts positions from the velocities,
moves them onto the constraints one after the other, and divides the displacement by the time step
for the new velocities.
Compliances are those of a continuous sheet, so that the same cloth hangs alike at any resolution.
The rim is an exception: it is half a cell wide, and as stiff as a whole cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flag.wind import Wind

GRAVITY = 9.81  # m/s², along −z
AIR = 1.2  # kg/m³


@dataclass(frozen=True)
class Fabric:
    """Material of the cloth, and coefficients of the air's forces on it.

    Args:
        density: kg/m².
        membrane: N/m, force a width against stretch along the threads.
        shear: N/m, the same across them.
        bending: N·m, moment a width over curvature.
        drag: coefficient of the pressure on a face that the air meets head-on.
        friction: coefficient of the force along a face.
        thickness: share of the grid's spacing that layers keep apart.
    """

    density: float = 0.15
    membrane: float = 1e4
    shear: float = 2e3
    bending: float = 5e-3
    drag: float = 1.6
    friction: float = 0.03
    thickness: float = 0.9


@dataclass(frozen=True, eq=False)
class Cloth:
    """A rectangle in the xz-plane, its left edge (x = 0) held by a pole.

    Args:
        rest: (V, 3) positions, in columns from the pole outwards, each from the bottom up.
        faces: (F, 3), seen from −y counter-clockwise.
        shape: columns and rows of vertices.
        spacing: metres between neighbours.
        springs: (S, 2) pairs that keep their distance: sides and both diagonals of every cell.
        lengths: (S,) those distances.
        spring_compliance: (S,) inverse stiffness, m/N.
        bends: (B, 3) three vertices in a row.
        bend_compliance: inverse stiffness of the second difference over them, m/N.
        mass: (V,) kg.
        pinned: (V,) true on the pole.
        fabric: the material.
    """

    rest: NDArray
    faces: NDArray
    shape: tuple[int, int]
    spacing: float
    springs: NDArray
    lengths: NDArray
    spring_compliance: NDArray
    bends: NDArray
    bend_compliance: float
    mass: NDArray
    pinned: NDArray
    fabric: Fabric

    def energy(self, x: NDArray, v: NDArray) -> float:
        """Kinetic, potential and elastic energy in joules; at rest 0."""
        kinetic = 0.5 * (self.mass[:, None] * v**2).sum()
        potential = GRAVITY * (self.mass * (x - self.rest)[:, 2]).sum()
        i, j = self.springs.T
        stretch = np.linalg.norm(x[i] - x[j], axis=1) - self.lengths
        a, b, c = self.bends.T
        bend = x[a] - 2.0 * x[b] + x[c]
        elastic = (stretch**2 / self.spring_compliance).sum()
        elastic += (bend**2).sum() / self.bend_compliance
        return float(kinetic + potential + 0.5 * elastic)


def rectangle(
    columns: int = 61, rows: int = 41, spacing: float = 0.025, fabric: Fabric | None = None
) -> Cloth:
    """A flat sheet of (columns − 1) by (rows − 1) square cells, each of two triangles.

    Diagonals alternate from cell to cell, so that the mesh prefers no direction.

    Args:
        columns, rows: vertices along x and z, at least 3.
        spacing: side of a cell in metres.
        fabric: the material; None is a light flag's.
    """
    if min(columns, rows) < 3:
        raise ValueError(f"columns, rows: expected at least 3, got {columns} and {rows}")
    fabric = fabric or Fabric()
    grid = np.arange(columns * rows).reshape(columns, rows)
    column, row = np.divmod(np.arange(columns * rows), rows)
    rest = spacing * np.stack([column, np.zeros_like(column), row], axis=1).astype(float)

    a, b, c, d = (q.ravel() for q in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]))
    even = ((column + row) % 2 == 0)[a]
    pattern = np.where(
        even[:, None], np.stack([a, b, c, a, c, d], axis=1), np.stack([a, b, d, b, c, d], axis=1)
    )
    faces = pattern.reshape(-1, 3)

    # Constraints of one batch share no vertex: no direction is favoured by their order.
    sides = _batches(grid[:-1], grid[1:]) + _batches(grid[:, :-1].T, grid[:, 1:].T)
    diagonals = _batches(grid[:-1, :-1], grid[1:, 1:]) + _batches(grid[:-1, 1:], grid[1:, :-1])
    springs = np.concatenate(sides + diagonals)
    i, j = springs.T
    lengths = np.linalg.norm(rest[i] - rest[j], axis=1)
    # A side stands for a strip as wide as it is long: k = Y h / h. The diagonals of a cell under
    # the shear γ change by ± γ h / √2 each: ½ G γ² h² = 2 · ½ k (γ h / √2)², k = G.
    side_count = sum(len(batch) for batch in sides)
    stiffness = np.where(np.arange(len(springs)) < side_count, fabric.membrane, fabric.shear)
    bends = np.concatenate(
        _batches(grid[:-2], grid[1:-1], grid[2:])
        + _batches(grid[:, :-2].T, grid[:, 1:-1].T, grid[:, 2:].T)
    )
    area = np.zeros(len(rest))
    np.add.at(area, faces, 0.5 * spacing**2 / 3.0)
    return Cloth(
        rest,
        faces,
        (columns, rows),
        spacing,
        springs,
        lengths,
        1.0 / stiffness,
        bends,
        # ½ D κ² h² with the curvature κ = |x₋ − 2x + x₊| / h².
        spacing**2 / fabric.bending,
        fabric.density * area,
        column == 0,
        fabric,
    )


def _batches(*ends: NDArray) -> list[NDArray]:
    """Constraints between equally shaped grids of vertices, in batches that share none."""
    stride = len(ends)
    return [np.stack([e[s::stride].ravel() for e in ends], axis=1) for s in range(stride)]


@dataclass(eq=False)
class Simulation:
    """A cloth in the wind.

    Args:
        cloth: what is simulated; it starts flat and at rest.
        wind: around it.
        gravity: m/s², along −z.
        steps: a second at which the wind and the pairs that may collide are looked up.
        substeps: of the dynamics in one of these.

    Attributes:
        x, v: (V, 3) positions and velocities.
        time: seconds.
    """

    cloth: Cloth
    wind: Wind
    gravity: float = GRAVITY
    steps: int = 240
    substeps: int = 20

    def __post_init__(self) -> None:
        """Start flat and at rest."""
        self.x = self.cloth.rest.copy()
        self.v = np.zeros_like(self.x)
        self.time = 0.0

    def run(self, seconds: float) -> None:
        """Go on for a time, rounded to whole steps."""
        cloth, fabric = self.cloth, self.cloth.fabric
        dt = 1.0 / (self.steps * self.substeps)
        free = np.where(cloth.pinned, 0.0, 1.0 / cloth.mass)
        for _ in range(round(seconds * self.steps)):
            _advance(
                self.x,
                self.v,
                free,
                cloth.faces,
                self.wind.velocity(self.x, self.time),
                0.5 * AIR * np.array([fabric.drag, fabric.friction]),
                self.gravity,
                cloth.springs,
                cloth.lengths,
                cloth.spring_compliance / dt**2,
                cloth.bends,
                cloth.bend_compliance / dt**2,
                self._near(),
                fabric.thickness * cloth.spacing,
                dt,
                self.substeps,
            )
            self.time += 1.0 / self.steps

    def _near(self) -> NDArray:
        """Pairs (P, 2) that may touch within a step, though the cloth does not join them closely.

        A step is short: in it, layers come nearer by less than the spacing.
        """
        reach = (1.0 + self.cloth.fabric.thickness) * self.cloth.spacing
        pairs = cKDTree(self.x).query_pairs(reach, output_type="ndarray")
        columns, rows = np.divmod(pairs, self.cloth.shape[1])
        apart = np.maximum(np.abs(np.ptp(columns, axis=1)), np.abs(np.ptp(rows, axis=1))) > 2
        pairs = pairs[apart]
        # The order that a tree finds them in is its own affair.
        return pairs[np.lexsort(pairs.T)].astype(np.int64)


@njit(cache=True)
def _advance(
    x,
    v,
    free,
    faces,
    wind,
    air,
    gravity,
    springs,
    lengths,
    spring_softness,
    bends,
    bend_softness,
    near,
    thickness,
    dt,
    substeps,
):
    """Substeps in place. `free` is the inverse mass, 0 where pinned; softness is α / dt²."""
    before = np.empty_like(x)
    for _ in range(substeps):
        _blow(x, v, free, faces, wind, air, dt)
        for n in range(len(x)):
            for k in range(3):
                before[n, k] = x[n, k]
            if free[n] > 0.0:
                v[n, 2] -= dt * gravity
                for k in range(3):
                    x[n, k] += dt * v[n, k]
        for s in range(len(springs)):
            _keep_distance(x, free, springs[s, 0], springs[s, 1], lengths[s], spring_softness[s])
        for s in range(len(bends)):
            _flatten(x, free, bends[s, 0], bends[s, 1], bends[s, 2], bend_softness)
        for s in range(len(near)):
            i, j = near[s]
            gap = 0.0
            for k in range(3):
                gap += (x[i, k] - x[j, k]) ** 2
            if gap < thickness**2:
                _keep_distance(x, free, i, j, thickness, 0.0)
        for n in range(len(x)):
            for k in range(3):
                v[n, k] = (x[n, k] - before[n, k]) / dt


@njit(cache=True)
def _blow(x, v, free, faces, wind, air, dt):
    """Pressure ½ρ c_n A |u_n| u_n and friction ½ρ c_t A |u_t| u_t of the air that passes a face."""
    e, f, n, u = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for face in range(len(faces)):
        a, b, c = faces[face]
        for k in range(3):
            e[k] = x[b, k] - x[a, k]
            f[k] = x[c, k] - x[a, k]
            u[k] = (wind[a, k] + wind[b, k] + wind[c, k] - v[a, k] - v[b, k] - v[c, k]) / 3.0
        n[0] = e[1] * f[2] - e[2] * f[1]
        n[1] = e[2] * f[0] - e[0] * f[2]
        n[2] = e[0] * f[1] - e[1] * f[0]
        doubled = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        if doubled == 0.0:
            continue
        head_on = (u[0] * n[0] + u[1] * n[1] + u[2] * n[2]) / doubled
        along = 0.0
        for k in range(3):
            n[k] /= doubled
            u[k] -= head_on * n[k]
            along += u[k] ** 2
        along = np.sqrt(along)
        for k in range(3):
            # A third of the force on half the doubled area.
            push = air[0] * abs(head_on) * head_on * n[k] + air[1] * along * u[k]
            push *= dt * doubled / 6.0
            v[a, k] += free[a] * push
            v[b, k] += free[b] * push
            v[c, k] += free[c] * push


@njit(cache=True)
def _keep_distance(x, free, i, j, length, softness):
    """Move two points towards their distance: C = |x_i − x_j| − length."""
    total = free[i] + free[j] + softness
    if free[i] + free[j] == 0.0:
        return
    d0, d1, d2 = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
    now = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    if now == 0.0:
        return
    scale = -(now - length) / (total * now)
    x[i, 0] += free[i] * scale * d0
    x[i, 1] += free[i] * scale * d1
    x[i, 2] += free[i] * scale * d2
    x[j, 0] -= free[j] * scale * d0
    x[j, 1] -= free[j] * scale * d1
    x[j, 2] -= free[j] * scale * d2


@njit(cache=True)
def _flatten(x, free, i, j, k, softness):
    """Move three points towards a line: C = x_i − 2 x_j + x_k, a vector."""
    total = free[i] + 4.0 * free[j] + free[k]
    if total == 0.0:
        return
    for axis in range(3):
        scale = -(x[i, axis] - 2.0 * x[j, axis] + x[k, axis]) / (total + softness)
        x[i, axis] += free[i] * scale
        x[j, axis] -= 2.0 * free[j] * scale
        x[k, axis] += free[k] * scale
