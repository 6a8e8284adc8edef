"""The demonstration: where its handles sit, where they go, and what is told about them."""

import numpy as np
import pytest

import deformer
from bars import bar_mesh, bending_bar
from deformer import Mesh
from deformer_app.cli import demo
from deformer_app.rendering.camera import upright_axes


def figure():
    """A figure of six boxes, 2 high, facing +z: vertices, faces and the vertices of each limb."""
    unit, faces = bar_mesh(rings=3, side=2)
    boxes = {  # middle and size of left–right, up and front–back
        "left leg": ([0.2, 0.45, 0], [0.2, 0.9, 0.2]),
        "right leg": ([-0.2, 0.45, 0], [0.2, 0.9, 0.2]),
        "body": ([0, 1.3, 0], [0.5, 0.8, 0.3]),
        "left arm": ([0.55, 1.55, 0], [0.7, 0.1, 0.1]),
        "right arm": ([-0.55, 1.55, 0], [0.7, 0.1, 0.1]),
        "head": ([0, 1.85, 0], [0.2, 0.3, 0.2]),
    }
    scaled = [(unit - [0, 0.5, 0]) / [0.2, 1, 0.2] * s + m for m, s in boxes.values()]
    count = len(unit)
    limbs = {name: range(i * count, (i + 1) * count) for i, name in enumerate(boxes)}
    vertices = np.concatenate(scaled)
    return vertices, np.concatenate([faces + i * count for i in range(len(boxes))]), limbs


@pytest.mark.parametrize("up", ["y", "z", "x"])
def test_handles_sit_on_the_limbs_whatever_axis_is_up(up):
    vertices, faces, limbs = figure()
    axes = upright_axes(up)
    drag = demo.record(Mesh(vertices @ axes + 3.0, faces), up)
    at = dict(zip(drag.names, drag.vertices, strict=True))
    for side in ("left", "right"):
        assert at[f"{side} toes"] in limbs[f"{side} leg"]
        assert at[f"{side} heel"] in limbs[f"{side} leg"]
        assert vertices[at[f"{side} toes"], 2] > vertices[at[f"{side} heel"], 2]
    assert at["left wrist"] in limbs["left arm"]
    assert at["head"] in limbs["head"]
    assert vertices[at["left toes"], 1] == pytest.approx(0)
    assert vertices[at["head"], 1] == pytest.approx(2)
    pinned = [name for name, hold in zip(drag.names, drag.pinned, strict=True) if hold]
    assert pinned == ["left toes", "left heel", "right toes", "right heel"]


def test_the_wrist_swings_about_the_shoulder_and_the_head_goes_down():
    vertices, faces, _ = figure()
    drag = demo.record(Mesh(vertices, faces))
    way = {name: [t for h, t in drag.moves if drag.names[h] == name] for name in drag.names}
    assert sorted(name for name, targets in way.items() if targets) == ["head", "left wrist"]
    start = vertices[drag.vertices[drag.names.index("left wrist")]]
    wrist = np.array([start, *way["left wrist"]])
    shoulder = [2 * demo.SHOULDER_SIDE, 2 - 2 * demo.SHOULDER_DROP]
    reach = np.sqrt(((wrist[:, :2] - shoulder) ** 2).sum(axis=1))
    assert np.ptp(reach) < 1e-9
    assert (np.diff(wrist[:, 1]) > 0).all()
    steps = np.sqrt((np.diff(wrist, axis=0) ** 2).sum(axis=1))
    assert steps.max() < 0.06  # a mouse does not jump
    head = np.array(way["head"])
    assert head[-1] == pytest.approx([*head[0][:1], 2 - 2 * demo.CROUCH, head[0][2]], abs=1e-3)


@pytest.mark.slow
def test_what_is_told_agrees_with_the_surfaces(tmp_path):
    model = deformer.train(bending_bar(), components=4, epochs=4)
    drag = demo.record(model.reference)
    takes = demo.replay(model, drag, lambda done: None)
    assert len(takes) == len(drag.moves) + 1
    for take in takes[:: len(takes) // 5]:
        apart = take.vertices[list(drag.vertices)] - take.targets
        assert take.residual == pytest.approx(np.sqrt((apart**2).sum(axis=1)), abs=1e-9)
    last = drag.moves[-1]
    assert np.array_equal(takes[-1].targets[last[0]], last[1])
    assert all(take.milliseconds > 0 for take in takes)
