"""Documents of every format: what becomes of them in another one, and what is refused."""

import numpy as np
import pytest

import tubes
from deformer import Document, InputError, Mesh, io, load_document, load_mesh, save_mesh
from deformer.documents import posed_glb
from deformer.documents.obj import ObjFile
from deformer.documents.ply import ply_polygons


def document(tmp_path, name="tube.obj", content=None):
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    (tmp_path / name).write_bytes(tubes.obj() if content is None else content)
    found = load_document(tmp_path / name)
    assert found is not None
    return found


def test_another_format_gets_polygons_and_what_it_knows(tmp_path):
    found = document(tmp_path)
    goal = tubes.positions(1.0)
    old = ObjFile(found.data).polygons({})
    assert old.uvs is not None and old.colours is not None
    new = ply_polygons(found.write(goal, ".ply"))
    np.testing.assert_array_equal(new.counts, old.counts)
    np.testing.assert_array_equal(new.corners, old.corners)
    assert new.uvs is not None and new.colours is not None
    np.testing.assert_allclose(new.uvs, np.nan_to_num(old.uvs), atol=1e-6)
    np.testing.assert_allclose(new.colours, old.colours, atol=0.5 / 255)
    (tmp_path / "pose.ply").write_bytes(found.write(goal, ".ply"))
    np.testing.assert_array_equal(load_mesh(tmp_path / "pose.ply").vertices, goal)
    np.testing.assert_array_equal(load_mesh(tmp_path / "pose.ply").faces, found.faces)


@pytest.mark.parametrize(
    ("name", "content"), [("tube.obj", tubes.obj()), ("tube.ply", tubes.ply(""))]
)
def test_a_glb_of_another_format_tells_whose_vertices_it_has(tmp_path, name, content):
    found, goal = document(tmp_path, name, content), tubes.positions(1.0)
    data, owners = posed_glb(found, goal, found.faces)
    assert data == found.write(goal, ".glb")
    shown = io.GltfScene(io.GltfAsset(data, "the file")).vertices({}, {}, 1)[0]
    np.testing.assert_allclose(shown, goal[owners], atol=1e-6)
    assert set(owners) == set(range(len(goal)))
    assert (len(owners) > len(goal)) == (name == "tube.obj")  # which has seams


@pytest.mark.parametrize("order", ["", ">"])
def test_a_ply_document_becomes_obj(tmp_path, order):
    found = document(tmp_path, "tube.ply", tubes.ply(order))
    goal = tubes.positions(1.0)
    old, new = ply_polygons(found.data), ObjFile(found.write(goal, ".obj")).polygons({})
    np.testing.assert_array_equal(new.counts, old.counts)
    np.testing.assert_array_equal(new.corners, old.corners)
    for name in ("uvs", "colours"):
        np.testing.assert_allclose(getattr(new, name), getattr(old, name), atol=1e-6)
    # Normals are shared by the same corners, whatever their numbers.
    pairs = np.unique(np.stack([old.normals, new.normals], 1), axis=0)
    assert len(pairs) == len(np.unique(old.normals)) == len(np.unique(new.normals))


def test_texture_coordinates_come_back_through_ply(tmp_path):
    found = document(tmp_path)
    first = ObjFile(found.data).polygons({})
    again = document(tmp_path, "again.ply", found.write(tubes.positions(), ".ply"))
    back = ObjFile(again.write(tubes.positions(), ".obj")).polygons({})
    np.testing.assert_array_equal(back.corners, first.corners)
    assert back.uvs is not None and first.uvs is not None
    np.testing.assert_allclose(back.uvs, np.nan_to_num(first.uvs), atol=1e-6)


def test_off_gets_polygons_and_stl_triangles(tmp_path):
    found = document(tmp_path)
    goal = tubes.positions(1.0)
    (tmp_path / "a.off").write_bytes(found.write(goal, ".off"))
    assert (tmp_path / "a.off").read_text().split("\n")[1] == "40 34 0"
    mesh = load_mesh(tmp_path / "a.off")
    np.testing.assert_array_equal(mesh.vertices, goal)
    np.testing.assert_array_equal(mesh.faces, found.faces)
    assert found.write(goal, ".stl") == io.mesh_bytes(Mesh(goal, found.faces), ".stl")


def test_smoothing_groups_stand_for_normals(tmp_path):
    lines = [line for line in tubes.obj().split(b"\n") if not line.startswith(b"vn")]
    text = b"\n".join(lines).replace(b"\\\n", b"")
    plain = b"\n".join(
        b" ".join(t.rpartition(b"/")[0] if t.count(b"/") == 2 else t for t in line.split(b" "))
        if line.startswith(b"f ") else line for line in text.split(b"\n"))  # fmt: skip
    mesh = ObjFile(plain).polygons({})
    assert mesh.normals is not None
    side, cap = mesh.normals[: 4 * 32], mesh.normals[4 * 32 :]
    assert len(np.unique(side)) == 40
    assert not set(side) & set(cap)


def test_shapes_without_more_than_triangles_have_no_document(tmp_path):
    mesh = Mesh(tubes.positions(), [[0, 1, 2]])
    io.save_mesh(tmp_path / "a.off", mesh)
    io.save_mesh(tmp_path / "a.stl", mesh)
    io.write_npz(tmp_path / "a.npz", {"vertices": mesh.vertices, "faces": mesh.faces})
    for name in ("a.off", "a.stl", "a.npz"):
        assert load_document(tmp_path / name) is None
    with pytest.raises(InputError, match="does not exist"):
        load_document(tmp_path / "b.xyz")


def test_the_document_of_a_directory_is_its_first_file(tmp_path):
    folder = tmp_path / "shapes"
    folder.mkdir()
    for n in (10, 2):
        (folder / f"{n}.obj").write_bytes(tubes.obj(n / 10))
    found = load_document(folder)
    assert found is not None
    assert (found.name, found.data) == ("2", tubes.obj(0.2))


def test_save_mesh_writes_like_a_document_or_a_file(tmp_path):
    found = document(tmp_path)
    mesh = Mesh(tubes.positions(1.0), found.faces)
    for like in (found, tmp_path / "tube.obj", str(tmp_path / "tube.obj")):
        save_mesh(tmp_path / "pose.obj", mesh, like=like)
        assert (tmp_path / "pose.obj").read_bytes() == found.write(mesh.vertices)
    save_mesh(tmp_path / "pose.ply", mesh, like=found)
    assert (tmp_path / "pose.ply").read_bytes() == found.write(mesh.vertices, ".ply")
    save_mesh(tmp_path / "bare.obj", mesh)
    assert (tmp_path / "bare.obj").read_bytes() == io.mesh_bytes(mesh, ".obj")


def test_a_document_of_another_mesh_is_refused(tmp_path):
    found = document(tmp_path)
    for mesh in (
        Mesh(tubes.positions()[1:], found.faces[:5]),
        Mesh(tubes.positions(), found.faces[::-1]),
    ):
        with pytest.raises(InputError, match=r"document tube\.obj: 40 vertices and 76 triangles"):
            save_mesh(tmp_path / "pose.obj", mesh, like=found)
    assert not (tmp_path / "pose.obj").exists()


def test_what_is_no_document_is_refused(tmp_path):
    found = document(tmp_path)
    mesh = Mesh(tubes.positions(), found.faces)
    with pytest.raises(InputError, match="like: expected a document"):
        save_mesh(tmp_path / "pose.obj", mesh, like=3)  # pyright: ignore
    with pytest.raises(InputError, match="suffix"):
        Document(".xyz", b"", "a", 40, found.faces)
    with pytest.raises(InputError, match="suffix"):
        found.write(mesh.vertices, ".xyz")
    with pytest.raises(InputError, match="vertices"):
        found.write(mesh.vertices[1:])
    with pytest.raises(InputError, match="vertices"):
        found.write(np.full((40, 3), np.nan))
