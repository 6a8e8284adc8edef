"""Files of a tube of quads with a seam: texture coordinates, normals, groups, materials, colours.

The tube lies along x. Its side is smooth and closed, but texture coordinates start anew at the
seam; its two caps are polygons of all vertices of a ring, with hard edges to the side.
"""

import numpy as np

AROUND, RINGS = 8, 5
LIBRARY = "newmtl skin\nKd 0.8 0.5 0.25\nd 0.5\nnewmtl steel\nKd 0.1 0.2 0.3\n"


def positions(bend=0.0, around=AROUND, rings=RINGS):
    """Positions (V, 3), ring by ring; `bend` turns the far end about z, in radians."""
    t = 2 * np.pi * np.arange(around) / around
    x, t = np.meshgrid(np.linspace(0, 2, rings), t, indexing="ij")
    y, z = 0.25 * np.cos(t), 0.25 * np.sin(t)
    if bend:
        radius = 2 / bend
        angle = x / radius
        x, y = (radius - y) * np.sin(angle), radius - (radius - y) * np.cos(angle)
    return np.round(np.stack([x, y, z], -1).reshape(-1, 3), 6)


def quads(around=AROUND, rings=RINGS):
    """Side faces, counter-clockwise from outside."""
    found = []
    for i in range(rings - 1):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            found.append([a, b, b + around, a + around])
    return found


def caps(around=AROUND, rings=RINGS):
    last = (rings - 1) * around
    return [list(range(around))[::-1], list(range(last, last + around))]


def side_normals(around=AROUND, rings=RINGS):
    t = 2 * np.pi * np.arange(around) / around
    return np.tile(np.stack([0 * t, np.cos(t), np.sin(t)], -1), (rings, 1))


def obj(bend=0.0, end="\n"):
    """An OBJ file with a bit of everything."""
    lines = ["# a tube", "mtllib tube.mtl", "o Tube", "vp 0.5 0.5"]
    for n, (x, y, z) in enumerate(positions(bend).tolist()):
        lines.append(f"v  {x:.6f} {y:.6f}\t{z:.6f}  {n / 100:.2f} 0.5 0.25" + " # c" * (n == 3))
    lines += [
        f"vt {j / AROUND:.4f} {i / (RINGS - 1):.4f}"
        for i in range(RINGS)
        for j in range(AROUND + 1)
    ]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in side_normals()[:AROUND].tolist()] * RINGS
    lines += ["vn -1 0 0", "vn 1 0 0", "g side left", "usemtl skin", "s 1"]
    for n, quad in enumerate(quads()):
        i, j = divmod(n, AROUND)
        row = AROUND + 1
        uv = [i * row + j, i * row + j + 1, (i + 1) * row + j + 1, (i + 1) * row + j]
        corners = [f"{v + 1}/{t + 1}/{v + 1}" for v, t in zip(quad, uv, strict=True)]
        lines.append("f " + " ".join(corners))
    lines += ["g caps", "usemtl steel", "s off"]
    for n, cap in enumerate(caps()):
        corners = [f"{v - AROUND * RINGS}//{n - 2}" for v in cap]
        lines.append("f " + " ".join(corners[:4]) + " \\" + end + " " + " ".join(corners[4:]))
    lines += ["l 1 2", "# the end \\"]
    return (end.join(lines) + end).encode()


VERTEX = [("flag", "u1"), ("x", "f4"), ("y", "f4"), ("z", "f4")]
VERTEX += [("nx", "f4"), ("ny", "f4"), ("nz", "f4"), ("s", "f4"), ("t", "f4")]
VERTEX += [("red", "u1"), ("green", "u1"), ("blue", "u1"), ("quality", "f8")]
TYPES = {"u1": "uchar", "f4": "float", "f8": "double", "i2": "short", "i4": "int"}


def ply(order, bend=0.0, vertex=VERTEX):
    """A PLY file of the side, with elements before and after; `order` is "", "<" or ">"."""
    points, normals = positions(bend), side_normals()
    V = len(points)
    columns = {
        **dict(zip(("x", "y", "z"), points.T, strict=True)),
        **dict(zip(("nx", "ny", "nz"), normals.T, strict=True)),
        "flag": np.arange(V) % 7,
        "s": np.arange(V) % AROUND / AROUND,
        "t": np.arange(V) // AROUND / RINGS,
        "red": np.arange(V),
        "green": 255 - np.arange(V),
        "blue": np.full(V, 10),
        "quality": np.arange(V) / 3,
    }
    table = np.empty(V, [(name, order + kind) for name, kind in vertex])
    for name, _ in vertex:
        table[name] = np.round(columns[name] * (1000 if dict(vertex)[name] == "i2" else 1), 6)
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = ["ply", f"format {kind} 1.0", "comment made by hand"]
    header += ["element lens 1", "property int focal", f"element vertex {V}"]
    header += [f"property {TYPES[kind]} {name}" for name, kind in vertex]
    header += [f"element face {len(quads()) + 1}", "property uchar label"]
    header += ["property list uchar int vertex_indices", "element edge 1", "property short v1"]
    faces = [*quads(), [0, 1, 2]]
    head = ("\n".join(header) + "\nend_header\n").encode()
    if not order:
        rows = ["85", *(" ".join(str(v) for v in row) for row in table.tolist())]
        rows += [f"{n} {len(face)} " + " ".join(map(str, face)) for n, face in enumerate(faces)]
        return head + ("\n".join([*rows, "-3"]) + "\n").encode()
    body = np.array([85], order + "i4").tobytes() + table.tobytes()
    for n, face in enumerate(faces):
        body += bytes([n, len(face)]) + np.array(face, order + "i4").tobytes()
    return head + body + np.array([-3], order + "i2").tobytes()
