"""`deformer demo`: replay a drag on an upright model, measure its time, and draw it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import Mesh
from deformer_app import console
from deformer_app.cli.folders import output_folder
from deformer_app.rendering.animation import save_animation
from deformer_app.rendering.camera import aim, eased, upright_axes
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import HandleGlyphs, contact_sheet, render, save_picture
from deformer_app.viewer.edit import NOISE

if TYPE_CHECKING:
    from deformer import DeformationModel

REACH_STEPS = 60  # mouse moves that raise the wrist
CROUCH_STEPS = 40  # mouse moves that push the head down
TILE = (420, 520)  # pixels of a picture on the sheet
FRAME = (360, 440)  # pixels of the animation
FRAME_STRIDE = 2  # mouse moves a picture of the animation
FPS = 20  # of the animation
_FILES = ("pose.ply", "sheet.png", "drag.gif")

# Lengths relative to the figure's height: shoulders are 0.1 from the middle and 0.82 high.
SHOULDER_SIDE, SHOULDER_DROP = 0.10, 0.18
WRIST = 0.68  # position of the wrist between shoulder (0) and fingertips (1)
RAISED = np.radians(80)  # elevation of the arm at the end of the reach
CROUCH = 0.12  # distance by which the head is pushed down


@dataclass(frozen=True, eq=False)
class Drag:
    """Handles on a figure, and the moves of the mouse.

    Args:
        names: name of each handle.
        vertices: vertex of each handle.
        pinned: true for handles that stay at their first position.
        moves: (handle, target (3,)) of every mouse move, in order.
    """

    names: tuple[str, ...]
    vertices: tuple[int, ...]
    pinned: tuple[bool, ...]
    moves: tuple[tuple[int, NDArray[np.float64]], ...]


@dataclass(frozen=True, eq=False)
class Step:
    """The pose after one move of the mouse.

    Args:
        vertices: (V, 3) vertices of the pose.
        targets: (H, 3) targets of the handles.
        residual: (H,) distances from handle to target.
        milliseconds: time from the move to the pose.
    """

    vertices: NDArray[np.float64]
    targets: NDArray[np.float64]
    residual: NDArray[np.float64]
    milliseconds: float


def record(reference: Mesh, up: str = "y") -> Drag:
    """A drag on any upright figure: feet pinned, a wrist raised, the head pushed down.

    The figure's outermost vertices become the handles, so that no vertex indices are needed.

    Args:
        reference: the figure, upright.
        up: its up axis, see `upright_axes`.
    """
    axes = upright_axes(up)
    local = reference.vertices @ axes.T
    left, height, front = local.T
    size = float(np.ptp(height))
    middle = (left.min() + left.max()) / 2
    # The arm turns about the shoulder in the plane of left and up.
    shoulder = np.array([middle + SHOULDER_SIDE * size, height.max() - SHOULDER_DROP * size])
    fingertip = local[np.argmax(left), :2]
    wrist = shoulder + WRIST * (fingertip - shoulder)
    off_wrist = np.sqrt(((local[:, :2] - wrist) ** 2).sum(axis=1))
    candidates = {
        "left toes": np.argmax(0.3 * left + 0.5 * front - height),
        "left heel": np.argmax(0.3 * left - 0.5 * front - height),
        "right toes": np.argmax(-0.3 * left + 0.5 * front - height),
        "right heel": np.argmax(-0.3 * left - 0.5 * front - height),
        "left wrist": np.argmin(off_wrist - 0.15 * front),
        "head": np.argmax(height - 0.2 * np.abs(left - middle)),
    }
    handles: dict[int, str] = {}
    for name, vertex in candidates.items():
        handles.setdefault(int(vertex), name)  # a pole has fewer
    names, vertices = tuple(handles.values()), tuple(handles)

    hand = local[candidates["left wrist"]]
    arm = hand[:2] - shoulder
    length, start = np.sqrt((arm**2).sum()), np.arctan2(arm[1], arm[0])
    moves = []
    for step in eased(REACH_STEPS):
        angle = start + step * (RAISED - start)
        target = [*(shoulder + length * np.array([np.cos(angle), np.sin(angle)])), hand[2]]
        moves.append((vertices.index(int(candidates["left wrist"])), target @ axes))
    head = local[candidates["head"]]
    for step in eased(CROUCH_STEPS):
        target = head - [0, step * CROUCH * size, 0]
        moves.append((vertices.index(int(candidates["head"])), target @ axes))
    return Drag(
        names, vertices, tuple("toes" in name or "heel" in name for name in names), tuple(moves)
    )


def replay(model: DeformationModel, drag: Drag, progress: Callable[[int], None]) -> list[Step]:
    """Solve every move of the drag; the first step is the pose before any move."""
    # As in the viewer, where pinned handles fix the body in space.
    solver = deformer.HandleSolver(model, noise=NOISE, freedom=1.0)
    targets = model.reference.vertices[list(drag.vertices)].copy()
    started = perf_counter()
    solver.set_handles(list(drag.vertices), targets)
    pose = solver.solve()
    steps = [_step(pose, targets, started)]
    for handle, target in drag.moves:
        targets[handle] = target
        started = perf_counter()
        pose = solver.drag(drag.vertices[handle], target)
        steps.append(_step(pose, targets, started))
        progress(len(steps))
    return steps


def run(model_name: str, output: Path, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Replay the drag and write sheet.png, drag.gif and pose.ply to `output`.

    Args:
        model_name: name of a shipped model, or a path; the model is upright.
        output: directory; an older one of this command is replaced.
        progress: called with the number of steps done and of all steps.

    Returns:
        Residuals by handle, milliseconds a frame, and the files.
    """
    with output_folder(output, "|".join(map(re.escape, _FILES))) as folder:
        model = deformer.load_model(model_name)
        up = str(model.summary.get("up", "y"))
        drag = record(model.reference, up)
        shown = range(0, len(drag.moves) + 1, FRAME_STRIDE)
        total = len(drag.moves) + 1 + len(shown)
        steps = replay(model, drag, lambda done: progress(done, total))

        pose = Mesh(steps[-1].vertices, model.reference.faces)
        deformer.save_mesh(folder / _FILES[0], pose, like=model)
        save_picture(folder / _FILES[1], _sheet(model.reference, drag, steps, up))
        camera = _camera(model.reference, steps, up, FRAME)
        frames = []
        for index in shown:
            frames.append(_picture(model.reference, drag, steps[index], camera, FRAME))
            progress(len(steps) + len(frames), total)
        save_animation(folder / _FILES[2], [*frames, *[frames[-1]] * 10], FPS)
    files = [output / name for name in _FILES]
    return {"model": model_name, **_summarize(model.reference, drag, steps, up), "files": files}


def show(result: dict[str, Any]) -> None:
    """Print the result of `run`."""
    size, time = result["height"], result["milliseconds"]
    rows = [
        [
            handle["name"],
            str(handle["vertex"]),
            "pinned" if handle["pinned"] else "dragged" if handle["moves"] else "held",
            f"{100 * handle['residual_rms'] / size:.2f}",
            f"{100 * handle['max_residual'] / size:.2f}",
        ]
        for handle in result["handles"]
    ]
    console.show_table(
        f"Distance from handle to target over {result['frames']} frames, % of the figure's height",
        ["handle", "vertex", "role", "rms", "largest"],
        rows,
    )
    console.show_table(
        f"Time a frame, from mouse move to {result['vertices']} new vertices, ms",
        ["first", "median", "p95", "largest"],
        [[f"{time[name]:.2f}" for name in ("first", "median", "p95", "largest")]],
    )
    for file in result["files"]:
        console.note(f"Wrote {file}")


def _step(pose: Any, targets: NDArray[np.float64], started: float) -> Step:
    milliseconds = 1000 * (perf_counter() - started)
    return Step(
        np.array(pose.vertices), targets.copy(), np.array(pose.residual, dtype=float), milliseconds
    )


def _summarize(reference: Mesh, drag: Drag, steps: list[Step], up: str) -> dict[str, Any]:
    height = float(np.ptp(reference.vertices @ upright_axes(up)[1]))
    residual = np.stack([step.residual for step in steps])
    moved = [handle for handle, _ in drag.moves]
    times = [step.milliseconds for step in steps[1:]]
    return {
        "vertices": len(reference.vertices),
        "frames": len(steps),
        "height": height,
        "handles": [
            {
                "name": name,
                "vertex": drag.vertices[index],
                "pinned": drag.pinned[index],
                "moves": moved.count(index),
                "residual_rms": float(np.sqrt((residual[:, index] ** 2).mean())),
                "max_residual": float(residual[:, index].max()),
            }
            for index, name in enumerate(drag.names)
        ],
        "milliseconds": {
            "first": steps[0].milliseconds,
            "median": float(np.median(times)),
            "p95": float(np.percentile(times, 95)),
            "largest": max(times),
        },
    }


def _camera(reference: Mesh, steps: list[Step], up: str, size: tuple[int, int]) -> Any:
    """A camera that shows the figure in all steps."""
    shapes = np.stack([reference.vertices, *[step.vertices for step in steps[::FRAME_STRIDE]]])
    return aim(shapes, up=up, aspect=size[0] / size[1])


def _picture(reference: Mesh, drag: Drag, step: Step, camera: Any, size: tuple[int, int]) -> Any:
    glyphs = HandleGlyphs(step.vertices[list(drag.vertices)], step.targets, drag.pinned)
    return render(Mesh(step.vertices, reference.faces), camera, size, glyphs)


def _sheet(reference: Mesh, drag: Drag, steps: list[Step], up: str) -> Any:
    """Reference, handles, and poses along the drag."""
    camera = _camera(reference, steps, up, TILE)
    raised = min(REACH_STEPS, len(steps) - 1)
    chosen = {
        "Handles": 0,
        "Wrist halfway": raised // 2,
        "Wrist raised": raised,
        "Head halfway": (raised + len(steps) - 1) // 2,
        "Head down": len(steps) - 1,
    }
    pictures = [render(reference, camera, TILE)]
    pictures += [_picture(reference, drag, steps[i], camera, TILE) for i in chosen.values()]
    return contact_sheet(trimmed(pictures), len(pictures), ["Reference", *chosen])
