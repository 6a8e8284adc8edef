"""OBJ documents: positions and normals change, and all other bytes stay."""

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import tubes
from deformer import load_document, load_mesh
from deformer.documents.obj import material_colours

# Statements that may change, as far as their numbers go.
VECTORS = re.compile(rb"^[ \t]*(v|vn)[ \t]", re.I)


def document(tmp_path, content, name="tube.obj"):
    (tmp_path / name).write_bytes(content)
    found = load_document(tmp_path / name)
    assert found is not None
    return found


def others(text):
    """All lines but those of positions and normals."""
    return [line for line in re.split(rb"\r\n|\n|\r", text) if not VECTORS.match(line)]


def vectors(text, keyword):
    rows = [line.split() for line in re.split(rb"[\r\n]+", text)]
    return np.array([[float(v) for v in row[1:4]] for row in rows if row[:1] == [keyword]])


ENCODINGS = {
    "plain": lambda text: text,
    "crlf": lambda text: text.replace(b"\n", b"\r\n"),
    "utf-8 mark": lambda text: b"\xef\xbb\xbf" + text,
    "utf-16": lambda text: b"\xff\xfe" + text.decode().encode("utf-16-le"),
    "utf-16 big": lambda text: b"\xfe\xff" + text.decode().encode("utf-16-be"),
}


def decoded(data):
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if data.startswith(mark):
            return data[2:].decode(encoding).encode()
    return data.removeprefix(b"\xef\xbb\xbf")


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_only_positions_and_normals_change(tmp_path, encoding):
    content = ENCODINGS[encoding](tubes.obj())
    found = document(tmp_path, content)
    goal = tubes.positions(1.0)
    written = found.write(goal)
    assert others(decoded(written)) == others(decoded(content))
    assert written[:3] == content[:3]
    assert decoded(written).count(b"\r") == decoded(content).count(b"\r")
    (tmp_path / "pose.obj").write_bytes(written)
    np.testing.assert_array_equal(load_mesh(tmp_path / "pose.obj").vertices, goal)
    # Colours and comments behind the positions stay, too.
    tail = rb"(?m)^v +\S+ \S+\t\S+(.*?)\r?$"
    assert re.findall(tail, decoded(written)) == re.findall(tail, decoded(content))


def test_carriage_returns_alone_end_lines(tmp_path):
    content = tubes.obj().replace(b"\\\n", b"").replace(b"\n", b"\r")
    written = document(tmp_path, content).write(tubes.positions(1.0))
    assert b"\n" not in written
    assert others(written) == others(content)
    np.testing.assert_array_equal(vectors(written, b"v"), tubes.positions(1.0))


def test_the_own_positions_give_the_own_bytes(tmp_path):
    for content in (tubes.obj(), ENCODINGS["utf-16"](tubes.obj())):
        found = document(tmp_path, content)
        assert found.write(load_mesh(tmp_path / "tube.obj").vertices) == content


def test_vertices_that_stay_keep_their_digits_and_so_do_normals_around_them(tmp_path):
    content = tubes.obj()
    goal = tubes.positions()
    goal[0] += 0.25
    old, new = content.split(b"\n"), document(tmp_path, content).write(goal).split(b"\n")
    changed = [line for line, other in zip(old, new, strict=True) if line != other]
    # One vertex, those of its own ring and the next that share a face with it, and one cap.
    assert [line.split()[0] for line in changed].count(b"v") == 1
    assert 1 < [line.split()[0] for line in changed].count(b"vn") <= 10


def test_smooth_sides_stay_smooth_and_edges_to_the_caps_hard(tmp_path):
    written = document(tmp_path, tubes.obj()).write(tubes.positions(1.0))
    normals = vectors(written, b"vn")
    V = tubes.AROUND * tubes.RINGS
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    middle = slice(2 * tubes.AROUND, 3 * tubes.AROUND)
    # About the axis in the middle of a bend by one radian, the tube points along (cos ½, sin ½, 0).
    x, y, z = tubes.side_normals()[middle].T
    c, s = np.cos(0.5), np.sin(0.5)
    expected = np.stack([c * x - s * y, s * x + c * y, z], 1)
    np.testing.assert_allclose(normals[middle], expected, atol=0.05)
    np.testing.assert_allclose(normals[V], [-1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(normals[V + 1], [np.cos(1), np.sin(1), 0], atol=1e-5)


def test_indices_of_what_the_file_lacks_and_broken_normals_are_no_obstacle(tmp_path):
    content = (
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0\nvn a b c\nvt 0 0\nf 1/9/9 2/1/1 3/1/2\nvn 0 0 1\n"
    )
    goal = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]])
    written = document(tmp_path, content).write(goal)
    assert written.splitlines()[:3] == [b"v 0 0 0", b"v 1 0 0", b"v 0.0 0.0 1.0"]
    assert b"vn 0 0\n" in written
    assert b"vn 0.0 -1.0 0.0\n" in written
    assert written.endswith(b"vn 0 0 1\n")


def test_material_libraries_tell_base_colours(tmp_path):
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    found = document(tmp_path, tubes.obj())
    assert found.colours == {"skin": (0.8, 0.5, 0.25, 0.5), "steel": (0.1, 0.2, 0.3, 1.0)}
    assert material_colours(b"Kd 1 1 1\nnewmtl a\nKd 2 0 0\nnewmtl b\nKd spectral x\n") == {}


number = st.floats(-1e6, 1e6, width=64)
space = st.sampled_from([b" ", b"\t", b"  ", b" \\\n "])
noise = st.sampled_from(
    [
        b"# v 1 2 3",
        b"vt 0.5 0.25",
        b"vp 1",
        b"g a b",
        b"",
        b"s 1",
        b"usemtl x y",
        b"# end \\",
        b"vn",
    ]
)


@st.composite
def files(draw):
    """An OBJ file, as bytes, with its vertices."""
    vertices = draw(st.lists(st.tuples(number, number, number), min_size=3, max_size=8))
    lines = []
    for row in vertices:
        lines.append(draw(noise))
        keyword = draw(st.sampled_from([b"v", b"V", b" v"]))
        tail = draw(st.sampled_from([b"", b" 1", b" 0.1 0.2 0.3", b" # tail", b" "]))
        lines.append(keyword + b"".join(draw(space) + repr(x).encode() for x in row) + tail)
    face = draw(st.permutations(range(1, len(vertices) + 1)))
    lines += [b"vn 0 0 1", b"f " + b" ".join(b"%d//-1" % n for n in face)]
    return b"\n".join(lines) + b"\n", np.array(vertices)


@settings(max_examples=60)
@given(files(), st.integers(0, 2**32 - 1))
def test_any_file_keeps_its_text_and_gives_back_the_positions(tmp_path_factory, made, seed):
    content, vertices = made
    folder = tmp_path_factory.mktemp("o")
    found = document(folder, content)
    assert found.write(vertices) == content
    goal = np.random.default_rng(seed).normal(size=vertices.shape)
    written = found.write(goal)
    (folder / "new.obj").write_bytes(written)
    np.testing.assert_array_equal(load_mesh(folder / "new.obj").vertices, goal)
    assert document(folder, written, "new.obj").write(goal) == written
    back = document(folder, written, "new.obj").write(vertices)
    np.testing.assert_array_equal(vectors(back.replace(b"\\\n", b""), b"vt"),
                                  vectors(content.replace(b"\\\n", b""), b"vt"))  # fmt: skip
    (folder / "old.obj").write_bytes(back)
    np.testing.assert_array_equal(load_mesh(folder / "old.obj").vertices, vertices)


def test_normals_that_stand_for_vertices_that_face_apart_are_told_once(tmp_path, caplog):
    """A tube whose rings share their normals, as programs write them, and one with its own."""
    shared = tubes.obj()
    for n in range(tubes.AROUND, tubes.AROUND * tubes.RINGS):
        shared = shared.replace(b"/%d " % (n + 1), b"/%d " % (n % tubes.AROUND + 1))
        shared = shared.replace(b"/%d\n" % (n + 1), b"/%d\n" % (n % tubes.AROUND + 1))
    for content, told in ((tubes.obj(), False), (shared, True)):
        found = document(tmp_path, content)
        found.write(tubes.positions(0.1))
        assert not caplog.messages
        for bend in (2.0, 2.5):
            found.write(tubes.positions(bend))
        assert len(caplog.messages) == told
        assert not told or "normals stand for vertices that now face up to" in caplog.messages[0]


def test_normals_that_no_corner_uses_stay(tmp_path):
    content = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1 2 3\n"
    written = document(tmp_path, content).write(np.eye(3))
    assert written == b"v 1.0 0.0 0.0\nv 0.0 1.0 0.0\nv 0.0 0.0 1.0\nvn 0 0 1\nf 1 2 3\n"
