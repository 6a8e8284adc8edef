"""What a user can do with the model on the desk: place and move handles, slide, mirror, compare.

A shell (a plain window, the Qt window, a test) feeds events to `controller`, calls `tick` when
there is time, and listens to `on_change`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import InputError, Mesh, io, spread
from deformer_app.rendering.offscreen import save_picture
from deformer_app.viewer.colouring import component_paint
from deformer_app.viewer.controller import Controller, Hover, Pixel
from deformer_app.viewer.gizmo import Mode, Motion
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Body, Edit, Handle, Kind, Session, point
from deformer_app.viewer.view_state import Desk
from deformer_app.viewer.worker import beside

# A region is held by so many of its vertices.
_HOLDS = 8
_SELECT = "Select a handle first: click it, or a row of the list"
_NEAR = 10.0  # pixels from a handle within which the mouse takes it


class Editor(Desk):
    """A desk that the user can work at; the controller's `Stage`.

    Args:
        view: the picture.
        notify: called on another thread when `tick` has something to do.
    """

    mode: Literal["drag", "paint"]

    def __init__(self, view: MeshView, notify: Callable[[], None] = lambda: None) -> None:
        """Begin without a model."""
        super().__init__(view, notify)
        self.controller = Controller(self)
        self.brush_radius = 0.08  # geodesic, in bounding diagonals
        self._symmetry: deformer.Symmetry | None = None
        self._grasped: Edit | None = None
        self._slid_from = np.zeros(0)
        self._patch: set[int] = set()

    def open_model(self, path: str | Path, session: Session | None = None) -> None:
        """Open a model, with a session of it or a new one.

        Raises:
            InputError: no such model, or the session belongs to another.
        """
        super().open_model(path, session)
        self._symmetry, self._grasped = None, None
        self._patch.clear()

    # What the controller sees and does: see `Stage`.

    @property
    def dragging(self) -> bool:
        """Whether a button of the mouse is down."""
        return self.controller.dragging

    @property
    def hint(self) -> str:
        """A line that says what the mouse would do here."""
        found = self._hover
        if self.preparing:
            return "Preparing the solver …"
        if self.mode == "paint":
            return "Paint a patch with the left button; Esc gives up"
        if found.part is not None:
            return "Drag to move exactly along this part; Shift for a finer step"
        if found.handle is not None:
            return "Drag the handle; S soft, E exact, P pin, Del removes it"
        if found.vertex is not None:
            return f"Vertex {found.vertex}: click to hold it, drag to pull it"
        return "Drag the body to bend it, beside it to look around.  F1: all keys"

    def vertex_at(self, pixel: Pixel) -> int | None:
        """The visible vertex nearest to a pixel on the surface; none before there is a pose."""
        return self.view.vertex_at(pixel) if self.is_open and not self.preparing else None

    def handle_at(self, pixel: Pixel) -> int | None:
        """Id of the visible handle at a pixel: where it is, or its target."""
        if not self.is_open or not self.edit.handles:
            return None
        marks, owners = self._marks()
        both = np.vstack([marks.positions, marks.targets])
        apart = self.camera.project(both, self.size) - pixel
        distance = np.sqrt((apart**2).sum(axis=1))
        for row in np.argsort(distance):
            if distance[row] > _NEAR:
                return None
            if self.view.sees(both[row]) or row >= len(owners):
                return owners[row % len(owners)]
        return None

    def handles_in(self, low: Pixel, high: Pixel) -> list[int]:
        """Ids of the handles within a rectangle of the picture."""
        marks, owners = self._marks()
        if not owners:
            return []
        at = self.camera.project(marks.positions, self.size)
        inside = ((at >= low) & (at <= high)).all(axis=1)
        return sorted({owners[n] for n in np.flatnonzero(inside)})

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """The centre of a handle's targets."""
        return np.array(self.edit.handle(handle).centre)

    def hover(self, found: Hover) -> None:
        """Light up what is under the cursor."""
        if found != self._hover:
            self._hover = found
            self._touch()
            self._emit("hover")

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, these too, or turn each over."""
        new = frozenset(handles)
        if toggle:
            new = self._selected ^ new
        elif add:
            new = self._selected | new
        if new != self._selected:
            self._selected = new
            self._touch()
            self._emit("handles")

    def place(self, vertex: int, add: bool = False) -> int:
        """Put a handle on a vertex where it is now; an old one there is taken instead."""
        for handle in self.edit.handles:
            if handle.vertices == (vertex,):
                self.select([handle.id], add=add)
                return handle.id
        at = point(self.vertices[vertex])
        handle = Handle(self.session.next_id(), (vertex,), (at,))
        self._grasped = None
        self.session.change(self.edit.with_handles([handle]))
        self.select([handle.id], add=add)
        self.ask(moving=True)
        return handle.id

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles from where they were when this drag began; pins stay."""
        if self._grasped is None:
            self._grasped = self.edit
        held = [h for h in self._grasped.handles if h.id in self._selected and h.kind != "pin"]
        self.session.change(self._grasped.with_handles(h.moved(motion) for h in held))
        self.ask(moving=True)
        self._emit("drag")

    def commit(self, label: str) -> None:
        """End what is under way as one step of the history."""
        self._grasped = None
        answer = self.answer
        fits = answer is not None and answer.request.edit == self.edit
        if self.session.commit(label, answer.solution if answer and fits else None):
            self._emit("history", "handles")
        self.ask()

    def revert(self) -> None:
        """Take back what is under way."""
        self._grasped = None
        self._patch.clear()
        self.view.show_patch(())
        if self.session.under_way:
            self.session.revert()
            self._keep_selection()
            self.ask(self.session.entry.solution)
        self._touch()

    def rubber_band(self, low: Pixel | None, high: Pixel | None) -> None:
        """Draw a rectangle, or none."""
        self.view.show_box(low, high)
        self._touch()

    def brush(self, vertex: int) -> None:
        """Paint the disc around a vertex, along the surface."""
        radius = self.brush_radius * self.model.reference.bounding_diagonal
        row = self.model.geodesics.row(vertex)
        self._patch.update(np.flatnonzero(row <= radius).tolist())
        self.view.show_patch(sorted(self._patch))
        self._touch()

    def resize_brush(self, factor: float) -> None:
        """Make the brush larger or smaller, within reason."""
        self.brush_radius = min(max(factor * self.brush_radius, 0.005), 0.5)

    def finish_region(self, add: bool = False) -> None:
        """Make one handle of the painted region."""
        patch = np.array(sorted(self._patch), dtype=np.int64)
        self._patch.clear()
        self.view.show_patch(())
        self.set_mode("drag")
        if not len(patch):
            return
        rest = self.model.reference.vertices[patch]
        chosen = patch[spread(rest - rest.mean(axis=0), _HOLDS)]
        handle = Handle(
            self.session.next_id(),
            tuple(chosen.tolist()),
            tuple(point(p) for p in self.vertices[chosen]),
            patch=tuple(patch.tolist()),
        )
        self.session.change(self.edit.with_handles([handle]))
        self.select([handle.id], add=add)
        self.commit("Paint region")

    # Commands.

    def change(self, label: str, edit: Edit) -> None:
        """Make a state the next step of the history and solve for it."""
        self.session.change(edit)
        self._keep_selection()
        self.commit(label)

    def undo(self) -> None:
        """Take the last step back."""
        if self.session.can_undo:
            self._show_entry(self.session.undo())

    def redo(self) -> None:
        """Take a step forth again."""
        if self.session.can_redo:
            self._show_entry(self.session.redo())

    def _show_entry(self, entry: Any) -> None:
        self._keep_selection()
        self.ask(entry.solution)
        self._emit("history", "handles")

    def start_from(self, name: str, code: ArrayLike) -> None:
        """Lean on a latent code, with no handles."""
        base = tuple(float(value) for value in np.asarray(code))
        self.change(f"Start from {name}", replace(self.edit, base=base, handles=()))

    def start_from_mesh(self, path: str | Path) -> None:
        """Lean on the code whose shape comes closest to a mesh; found beside the window.

        Raises:
            InputError: it has another number of vertices.
        """
        mesh, model = self._load_alike(path), self.model

        def wait() -> Iterator[None]:
            self.note(f"Looking for the code of {path} …")
            code = yield from beside(lambda: model.fit(mesh.vertices))
            if self._model is model:
                self.start_from(Path(path).name, code)

        self.run(wait())

    def reset(self) -> None:
        """Go back to the reference, with no handles."""
        self.start_from("reference", self.start_codes()["Reference"])

    def use_as_base(self) -> None:
        """Lean on the pose that is shown; handles stay where they are."""
        if self.answer is not None:
            self.change("Start from this pose", replace(self.edit, base=self.answer.solution.z))

    def slide(self, component: int, value: float) -> None:
        """Set a component of the code; handles resist. `commit` ends it. Not during a drag."""
        if self.dragging:
            return
        if self._grasped is None:
            self._grasped = self.edit
            self._slid_from = self.code
        base = list(self._grasped.base)
        base[component] += value - float(self._slid_from[component])
        self.session.change(replace(self._grasped, base=tuple(base)))
        self.ask(moving=True)

    def set_noise(self, noise: float) -> None:
        """How hard the prior holds; `commit` ends it."""
        self.session.change(replace(self.edit, noise=noise))
        self.ask(moving=True)

    def set_body(self, body: Body) -> None:
        """Whether the body may turn and travel as a whole."""
        self.change("Body " + body, replace(self.edit, body=body))

    def set_kind(self, kind: Kind) -> None:
        """Make the selected handles soft, exact or pins."""
        held = [replace(h, kind=kind) for h in self._held()]
        if kind == "pin":
            held = [
                replace(h, targets=tuple(point(p) for p in self.vertices[list(h.vertices)]))
                for h in held
            ]
        if held:
            self.change(f"Make {kind}", self.edit.with_handles(held))
        else:
            self.note(_SELECT)

    def set_weight(self, weight: float) -> None:
        """Weigh the selected handles; `commit` ends it."""
        held = [replace(handle, weight=weight) for handle in self._held()]
        self.session.change(self.edit.with_handles(held))
        self.ask(moving=True)

    def set_centre(self, centre: ArrayLike) -> None:
        """Move the selected handles so that their common centre is at a point (3,)."""
        held = self._movable()
        if held:
            before = np.mean([handle.centre for handle in held], axis=0)
            shift = np.asarray(centre, dtype=np.float64) - before
            moved = [handle.moved(lambda p: p + shift) for handle in held]
            self.change("Move", self.edit.with_handles(moved))

    def delete(self) -> None:
        """Remove the selected handles."""
        if self._selected:
            self.change("Delete", self.edit.without(self._selected))
        else:
            self.note(_SELECT)

    def clear(self) -> None:
        """Remove all handles."""
        if self.edit.handles:
            self.change("Clear handles", replace(self.edit, handles=()))

    @property
    def symmetry(self) -> deformer.Symmetry:
        """The body's mirror plane, found at the first use."""
        if self._symmetry is None:
            self._symmetry = deformer.find_symmetry(self.model.reference)
        return self._symmetry

    def preview(self, component: int | None) -> None:
        """Colour the surface by the support of a component, or as before."""
        if self.activations is None:
            return
        if component is None:
            self.view.paint(None if self.answer is None else self._paint)
        else:
            self.view.paint(component_paint(self.model, self.activations, component))
        self._touch()

    def find_symmetry(self) -> None:
        """Find the mirror plane again after `tell_symmetry`."""
        self._symmetry = None

    def tell_symmetry(self, axis: str) -> None:
        """Mirror about the plane through the reference's middle across "x", "y" or "z"."""
        reference = self.model.reference
        middle = 0.5 * (reference.vertices.min(axis=0) + reference.vertices.max(axis=0))
        self._symmetry = deformer.symmetry_about(reference, middle, np.eye(3)["xyz".index(axis)])

    def mirror(self) -> None:
        """Copy the selected handles, or all, to the other side; what is there already moves."""
        symmetry, edit = self.symmetry, self.edit
        number, changed = self.session.next_id(), []
        sources = self._held() or list(edit.handles)
        for handle in sources:
            vertices = tuple(symmetry.opposite[list(handle.vertices)].tolist())
            patch = tuple(sorted(set(symmetry.opposite[list(handle.patch)].tolist())))
            there = [h for h in edit.handles if set(h.vertices) & set(vertices)]
            if any(h.id == handle.id for h in there):
                continue  # on the plane: its own mirror image
            copy = replace(
                handle,
                id=there[0].id if there else number,
                vertices=vertices,
                targets=tuple(point(p) for p in symmetry.mirror(handle.targets)),
                patch=patch,
            )
            number += not there
            changed.append(copy)
        if changed:
            self.change("Mirror", edit.with_handles(changed))
            self.select([h.id for h in changed], add=True)
        else:
            self.note("Nothing to mirror: place a handle beside the plane of symmetry first")

    def suggest(self) -> None:
        """Place a handle where it would tell most, and show where that is."""
        if self.look.colour != "uncertainty":
            self.change_look(colour="uncertainty")
            self.note("Red is where one more handle would tell most; N again places it")
        elif self.answer is not None and self.answer.suggestion is not None:
            self.place(self.answer.suggestion)
            self.commit("Suggested handle")

    def set_mode(self, mode: Literal["drag", "paint"]) -> None:
        """Drag handles, or paint a region."""
        self.mode = mode
        self._touch()
        self._emit("look")

    def set_gizmo(self, mode: Mode) -> None:
        """What the manipulator of several handles does."""
        self.gizmo_mode, self.gizmo_shown = mode, True
        self._touch()
        self._emit("look")

    def screenshot(self, path: str | Path) -> None:
        """Write the picture as it is, sharply."""
        save_picture(path, self.view.picture())

    def export_pose(self, path: str | Path) -> None:
        """Write the surface that is shown as a mesh file.

        Raises:
            InputError: there is no pose yet.
        """
        if self.preparing:
            raise InputError(f"{path}: the solver is still being prepared; try again in a moment")
        io.save_mesh(path, Mesh(self.vertices, self.model.reference.faces))

    def export_handles(self, path: str | Path) -> None:
        """Write the targets as `deformer fit` reads them."""
        # A vertex may belong to several handles; a file names it once.
        rows = list({row["vertex"]: row for row in self.session.summary()["handles"]}.values())
        if not rows:
            raise InputError(f"{path}: there are no handles to write; place one first")
        io.write_json(path, {"handles": rows})


def opening(model: str | None, session: Path | None) -> tuple[str, Session | None]:
    """The model to open first, and the session to open with it, both looked at before any window.

    Raises:
        InputError: no such model, a session that is damaged, missing or of another model.
    """
    saved = Session.load(session) if session is not None else None
    first = model or (saved.model.path if saved else "humanoid")
    loaded = deformer.load_model(first)
    if saved is not None and session is not None:
        saved.check_fits(loaded, session)
    return first, saved
