"""PLY documents: positions and normals change, and all other values, types and bytes stay."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import tubes
from deformer import InputError, load_document, load_mesh
from deformer.documents.ply_tables import ply_tables

ORDERS = ["", "<", ">"]


def document(tmp_path, content, name="tube.ply"):
    (tmp_path / name).write_bytes(content)
    found = load_document(tmp_path / name)
    assert found is not None
    return found


def vertices_of(tmp_path, content):
    (tmp_path / "again.ply").write_bytes(content)
    return load_mesh(tmp_path / "again.ply").vertices


@pytest.mark.parametrize("order", ORDERS)
def test_only_positions_and_normals_change(tmp_path, order):
    content = tubes.ply(order)
    goal = tubes.positions(1.0)
    written = document(tmp_path, content).write(goal)
    body = content.index(b"end_header\n")
    assert written[:body] == content[:body]
    np.testing.assert_array_equal(vertices_of(tmp_path, written).astype("f4"), goal.astype("f4"))
    old, new = ply_tables(content).tables, ply_tables(written).tables
    for name, table in old.items():
        for column, values in table.scalars.items():
            if column not in ("x", "y", "z", "nx", "ny", "nz"):
                np.testing.assert_array_equal(new[name].scalars[column], values)
        for column, (counts, values) in table.lists.items():
            np.testing.assert_array_equal(new[name].lists[column][0], counts)
            np.testing.assert_array_equal(new[name].lists[column][1], values)
    if order:
        assert len(written) == len(content)
        end = old["face"].start
        assert written[end:] == content[end:]


@pytest.mark.parametrize("order", ORDERS)
def test_normals_follow(tmp_path, order):
    written = document(tmp_path, tubes.ply(order)).write(tubes.positions(1.0))
    scalars = ply_tables(written).tables["vertex"].scalars
    normals = np.stack([scalars[name] for name in ("nx", "ny", "nz")], 1)
    x, y, z = tubes.side_normals().T
    turn = np.repeat(np.linspace(0, 1, tubes.RINGS), tubes.AROUND)
    c, s = np.cos(turn), np.sin(turn)
    inner = slice(tubes.AROUND, -tubes.AROUND)
    expected = np.stack([c * x - s * y, s * x + c * y, z], 1)
    np.testing.assert_allclose(normals[inner], expected[inner], atol=0.05)


@pytest.mark.parametrize("order", ORDERS)
def test_the_own_positions_give_the_own_bytes(tmp_path, order):
    content = tubes.ply(order)
    found = document(tmp_path, content)
    assert found.write(load_mesh(tmp_path / "tube.ply").vertices) == content


@pytest.mark.parametrize("order", ORDERS)
def test_positions_of_whole_numbers_become_float(tmp_path, order):
    vertex = [(name, "i2" if name in "xyz" else kind) for name, kind in tubes.VERTEX]
    content = tubes.ply(order, vertex=vertex)
    found = document(tmp_path, content)
    goal = 1000 * tubes.positions(1.0) + 0.25
    written = found.write(goal)
    assert b"property float x\n" in written
    assert b"property uchar flag\n" in written
    assert b"property short v1\n" in written
    np.testing.assert_array_equal(vertices_of(tmp_path, written).astype("f4"), goal.astype("f4"))
    old, new = ply_tables(content).tables["vertex"], ply_tables(written).tables["vertex"]
    np.testing.assert_array_equal(new.scalars["quality"], old.scalars["quality"])
    assert found.write(load_mesh(tmp_path / "tube.ply").vertices) == content


def test_positions_beyond_single_precision_are_refused(tmp_path):
    found = document(tmp_path, tubes.ply("<"))
    with pytest.raises(InputError, match="single-precision"):
        found.write(1e50 * (1 + tubes.positions()))


def test_vertices_split_at_a_seam_keep_one_normal(tmp_path):
    """Two sheets that meet at x = 0, split there: smooth with equal normals, hard with others."""
    points = np.array([[-1, 0, 0], [-1, 1, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 1, 0],
                       [1, 0, 0], [1, 1, 0]], dtype=float)  # fmt: skip
    faces = [[0, 2, 3, 1], [4, 6, 7, 5]]
    for tilt, smooth in ((0.0, True), (0.5, False)):
        rows = [[*p, tilt * (n > 3), 0, 1] for n, p in enumerate(points.tolist())]
        text = "ply\nformat ascii 1.0\nelement vertex 8\n"
        text += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        text += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        text += "".join(" ".join(map(str, row)) + "\n" for row in rows)
        text += "".join("4 " + " ".join(map(str, face)) + "\n" for face in faces)
        goal = points.copy()
        goal[[6, 7], 2] = 1.0
        written = document(tmp_path, text.encode()).write(goal)
        scalars = ply_tables(written).tables["vertex"].scalars
        normals = np.stack([scalars[name] for name in ("nx", "ny", "nz")], 1)
        assert np.allclose(normals[2], normals[4]) == smooth
        left = [-np.sin(np.pi / 8), 0, np.cos(np.pi / 8)] if smooth else [0, 0, 1]
        np.testing.assert_allclose(normals[2], left, atol=1e-6)


@settings(max_examples=60)
@given(
    st.sampled_from(ORDERS),
    st.permutations(["x", "y", "z", "a", "b", "nx", "ny", "nz"]),
    st.lists(st.sampled_from(["f4", "f8"]), min_size=8, max_size=8),
    st.integers(0, 2**32 - 1),
)
def test_any_order_and_type_of_properties_is_kept(tmp_path_factory, order, names, kinds, seed):
    folder = tmp_path_factory.mktemp("p")
    random = np.random.default_rng(seed)
    table = np.empty(5, [(n, (order or "<") + k) for n, k in zip(names, kinds, strict=True)])
    for name in names:
        table[name] = random.normal(size=5)
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {kind} 1.0\nelement vertex 5\n"
    head += "".join(f"property {tubes.TYPES[k]} {n}\n" for n, k in zip(names, kinds, strict=True))
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    faces = [[0, 1, 2], [4, 3, 2, 1]]
    if order:
        rows = b"".join(bytes([len(f)]) + np.array(f, order + "i4").tobytes() for f in faces)
        content = head.encode() + table.tobytes() + rows
    else:
        lines = [" ".join(map(repr, row)) for row in table.tolist()]
        lines += [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
        content = (head + "\n".join(lines)).encode()
    found = document(folder, content)
    own = load_mesh(folder / "tube.ply").vertices
    assert found.write(own) == content
    goal = random.normal(size=(5, 3))
    written = found.write(goal)
    types = dict(zip(names, kinds, strict=True))
    expected = np.stack([goal[:, k].astype(types[axis]) for k, axis in enumerate("xyz")], 1)
    again = vertices_of(folder, written)
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(again[:, k].astype(types[axis]), expected[:, k])
    new = ply_tables(written).tables["vertex"].scalars
    for name in "ab":
        np.testing.assert_array_equal(new[name].astype("f8"), table[name].astype("f8"))
    length = np.linalg.norm([new["nx"], new["ny"], new["nz"]], axis=0)
    np.testing.assert_allclose(length, 1, atol=1e-6)
