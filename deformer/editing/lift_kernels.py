"""Kernels of a surface that follows nodes; see `kernels` for how they are written."""

from __future__ import annotations

from deformer.compilation import called_with, njit
from deformer.editing.kernels import MATRICES, memory_

# Numbers of a node's frame: three rows of M and t, filled up to a line of the processor's cache.
FRAME = 16
# Nodes that a vertex follows.
INFLUENCES = 4


@called_with("void(i8, i8, f4[::1], f4[::1], f4[:, ::1], f4[::1], f4[::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def node_frames(start, stop, R, T, p, v, frames):
    """Frames (16 a node) of affine maps M x + t, M = R T, that take v_j (3 a node) to p_j."""
    for j in range(start, stop):
        o, f = 9 * j, FRAME * j
        x, y, z = v[3 * j], v[3 * j + 1], v[3 * j + 2]
        for a in range(3):
            r0, r1, r2 = R[o + 3 * a], R[o + 3 * a + 1], R[o + 3 * a + 2]
            m0 = r0 * T[o] + r1 * T[o + 3] + r2 * T[o + 6]
            m1 = r0 * T[o + 1] + r1 * T[o + 4] + r2 * T[o + 7]
            m2 = r0 * T[o + 2] + r1 * T[o + 5] + r2 * T[o + 8]
            frames[f + 4 * a], frames[f + 4 * a + 1], frames[f + 4 * a + 2] = m0, m1, m2
            frames[f + 4 * a + 3] = p[j, a] - (m0 * x + m1 * y + m2 * z)


@called_with(
    "void(i8, i8, i4[::1], f4[::1], f4[::1], f4[::1], f4[:, ::1], f4[:, ::1], f4[::1], i8[::1], "
    "f8[:, ::1], f8[::1], f8[:, ::1])"
)
@njit(nogil=True, error_model="numpy", fastmath=True)
def lift(start, stop, nodes, weights, v, frames, rows, push, shift, order, Q, origin, out):
    """out_order[i] = Q (Σ_k w_ik (M_k v_i + t_k) + Σ_h rows_hi push_h + shift) + origin.

    Args:
        start, stop: range of vertices i, in the order of the surface.
        nodes, weights: 4 a vertex: the nodes k, and w_ik.
        v: the reference, 3 a vertex.
        frames: M_k and t_k, 16 a node.
        rows: (H, V).
        push: (H, 3).
        shift: (3,).
        order: (V,) the vertex in each place.
        Q, origin: (3, 3) and (3,) the rigid motion.
        out: (V, 3).
    """
    memory = memory_()
    a, b, c = memory[0], memory[1], memory[2]
    for begin in range(start, stop, MATRICES):
        count = min(MATRICES, stop - begin)
        for n in range(count):
            a[n], b[n], c[n] = shift[0], shift[1], shift[2]
        for h in range(len(push)):
            row = rows[h, begin : begin + count]
            x, y, z = push[h, 0], push[h, 1], push[h, 2]
            for n in range(count):
                a[n] += row[n] * x
                b[n] += row[n] * y
                c[n] += row[n] * z
        for n in range(count):
            i = begin + n
            x, y, z = v[3 * i], v[3 * i + 1], v[3 * i + 2]
            px, py, pz = a[n], b[n], c[n]
            # Not by loops over the frame: the compiler would keep the sums in memory.
            for k in range(INFLUENCES * i, INFLUENCES * (i + 1)):
                o, w = FRAME * nodes[k], weights[k]
                px += w * (frames[o] * x + frames[o + 1] * y + frames[o + 2] * z + frames[o + 3])
                o += 4
                py += w * (frames[o] * x + frames[o + 1] * y + frames[o + 2] * z + frames[o + 3])
                o += 4
                pz += w * (frames[o] * x + frames[o + 1] * y + frames[o + 2] * z + frames[o + 3])
            for d in range(3):
                out[order[i], d] = Q[d, 0] * px + Q[d, 1] * py + Q[d, 2] * pz + origin[d]
