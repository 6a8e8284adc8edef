"""Frames of a sequence, fitted window by window, and the floor that their shapes stay above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deformer.editing.batch_numba import Boolean, Frames, NumbaFrames
from deformer.editing.energy import HandleEnergy
from deformer.editing.finished_windows import FinishedWindows, SolvedWindow
from deformer.editing.floor import Floor, FloorContacts, FloorTerm
from deformer.editing.green_functions import HandleBasis
from deformer.editing.misfit_track import MisfitTrack
from deformer.editing.separate_frames import SeparateFrames
from deformer.editing.sequence_energy import SequenceEnergy
from deformer.editing.track_source import TrackSource
from deformer.editing.tracks import Rows as Handles
from deformer.editing.unknowns import Unknowns
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, log_to_rotation
from deformer.linalg import one_blas_thread, resolve_device
from deformer.workspace import Rows, Workspace, slices

# Number of frames in a window, and of frames after it that are solved for with it, and again with
# the next window.
WINDOW = 512
_AHEAD = 32
# Shapes that are computed between two reports of progress.
_SHAPES = 64
# Most fits that contacts with the floor are added after.
_FLOOR_ROUNDS = 4


def sizes() -> list[int]:
    """Numbers that decide which frames are solved for together."""
    return [WINDOW, _AHEAD]


class Progress:
    """Reports frames that are done.

    Args:
        total: number of frames.
        report: called with the numbers of frames done and of all frames; None calls nothing.
    """

    def __init__(self, total: int, report: Callable[[int, int], None] | None) -> None:
        """Start with no frame done."""
        self._total, self._report, self._done = total, report, 0

    def begin(self) -> None:
        """Start over, before all frames are fitted once more."""
        self._done = 0

    def step(self) -> None:
        """Report the same number again."""
        if self._report is not None:
            self._report(self._done, self._total)

    def add(self, frames: int) -> None:
        """Report so many more frames."""
        self._done += frames
        self.step()


@dataclass(frozen=True, eq=False)
class FittedFrames:
    """Some frames of a sequence that follow each other, fitted.

    Args:
        frames: range of the m frames.
        X: (m, K+6) unknowns.
        shapes: (m, V, 3) positions of the closed surface.
        steps: of whole windows, taken since the frames before.
    """

    frames: slice
    X: FloatArray
    shapes: FloatArray
    steps: int


@dataclass(frozen=True, eq=False)
class WindowFits:
    """Fits the frames of a sequence, window by window; later windows need little of earlier ones.

    Args:
        basis: the model's handles.
        energy: of a frame, without handles.
        first: (K+6,) unknowns from which the first frame starts.
        tracks: the handles.
        centres: gives whitened codes (m, K) that are the prior's means of the frames of a slice;
            None is zeros.
        smoothness, relaxation, device, backend: as in `fit_sequence`.
        key_frames: as in `fit_sequence`, ascending.
        own_noise: true if each frame of a sequence without smoothness chooses its noise.
        misfit: τ, in bounding diagonals.
        progress: is told of frames.
        finished: windows of an earlier process, and where windows of this one are kept.
    """

    basis: HandleBasis
    energy: HandleEnergy
    first: FloatArray
    tracks: TrackSource
    centres: Callable[[slice], FloatArray] | None
    smoothness: float
    key_frames: Sequence[int]
    own_noise: bool
    misfit: float
    relaxation: int
    device: str
    backend: str | None
    progress: Progress
    finished: FinishedWindows

    def run(
        self, attempt: int, floor: Floor | None, contacts: list[int], known: Rows | None
    ) -> Iterator[FittedFrames]:
        """Fit the frames, and compute their shapes some at a time.

        Args:
            attempt: number of fits of all frames before this one.
            floor: what the contacts touch.
            contacts: vertices that touch it.
            known: (F, K+6) unknowns near the minimum, or None; read up to the end of a window, and
                the frames after it, before those of the window are yielded.
        """
        basis, F = self.basis, len(self.tracks)
        rows, index = self._rows(slice(0, 1), contacts)
        term = None
        if floor is not None and contacts:
            term = FloorTerm(floor, index, basis.model.reference.bounding_diagonal)
        with one_blas_thread():
            basis.set_points(rows.points)
            batch = _backend(basis, self.device, self.backend)
            errors = basis.model_errors(self.misfit) if self.misfit and rows.points else None
        energy, missed = replace(self.energy, errors=errors, floor=term), None
        if errors is not None:
            missed = MisfitTrack(errors, energy.noise, self.smoothness)
        before = np.zeros((0, energy.size))
        self.progress.begin()
        for number, part in enumerate(slices(F, WINDOW)):
            start = part.start
            seen = slice(start, min(part.stop + (_AHEAD if self.smoothness > 0 else 0), F))
            rows, _ = self._rows(seen, contacts)
            near = None if known is None else np.array(known[seen])
            with one_blas_thread():
                found = self._solved(attempt, number, energy, batch, rows, before, near)
                window, steps = found.X, found.steps
                wanted, reached = self._goals(batch, energy, missed, part, rows, found)
            X = window[: part.stop - start]
            before = np.concatenate([before, X])[-2:]
            for some in slices(len(X), _SHAPES):
                shapes = np.empty((some.stop - some.start, len(basis.model.reference.vertices), 3))
                with one_blas_thread():
                    Q = log_to_rotation(Unknowns(X[some]).rotation)
                    motion = Q, energy.centroids(X[some])
                    goals = wanted[some], reached[some]
                    batch.shapes(energy.codes(X[some]), *motion, *goals, self.relaxation, shapes)
                self.progress.add(len(shapes))
                frames = slice(start + some.start, start + some.stop)
                yield FittedFrames(frames, X[some], shapes, 0 if some.start else steps)

    def _rows(self, frames: slice, contacts: list[int]) -> tuple[Handles, IntArray]:
        """The handles' points in frames, with contacts, and the indices of these."""
        return self.tracks.part(frames).rows(self.basis.frames).with_contacts(contacts)

    def _solved(
        self,
        attempt: int,
        number: int,
        energy: HandleEnergy,
        batch: Frames,
        rows: Handles,
        before: FloatArray,
        known: FloatArray | None,
    ) -> SolvedWindow:
        """Solve for the frames of a window, and those after it."""
        found = self.finished.load(attempt, number)
        if found is not None:
            return found
        m, start = len(rows.targets), number * WINDOW
        centres = None if self.centres is None else self.centres(slice(start, start + m))
        handles = rows.targets - rows.gaps, rows.weights
        guess, step = before[-1] if len(before) else self.first, self.progress.step
        if self.smoothness > 0:
            sequence = SequenceEnergy(energy, batch, *handles, self.smoothness, centres, step)
            X, steps = sequence.solve(slice(0, m), guess, before, known)
            found = SolvedWindow(X, np.full(m, energy.noise), steps)
        else:
            keys = [frame - start for frame in self.key_frames if 0 <= frame - start < m]
            single = SeparateFrames(
                energy, self.basis, *handles, centres, keys, self.own_noise, step
            )
            found = SolvedWindow(*single.solve(guess, known))
        self.finished.save(attempt, number, found)
        return found

    def _goals(
        self,
        batch: Frames,
        energy: HandleEnergy,
        missed: MisfitTrack | None,
        part: slice,
        rows: Handles,
        window: SolvedWindow,
    ) -> tuple[FloatArray, Boolean]:
        """Where handles are to be in the frames of a window (n, H, 3), and which are (n, H)."""
        n = part.stop - part.start
        wanted, exact, gaps = rows.targets[:n], rows.exact[:n], rows.gaps[:n]
        # As in `PosedSurface`: the shape deforms by what is left of soft handles, too, ...
        if missed is not None:
            at = _handle_positions(batch, energy, window.X)
            # A frame of another noise is one of other weights.
            weights = rows.weights * ((energy.noise / window.noise) ** 2)[:, None]
            near = at[:n] + missed.expected(n, weights, rows.targets - rows.gaps - at) + gaps
            return np.where(exact[..., None], wanted, near), rows.used[:n]
        # ... or these stay where the code has them, beside exact ones.
        seen = rows.weights[:n] > 0
        moved: Boolean = np.asarray(exact.any(axis=1) | (seen & gaps.any(axis=2)).any(axis=1))
        held = moved[:, None] & seen
        if (held == exact).all():
            return wanted, exact
        near = _handle_positions(batch, energy, window.X[:n]) + gaps
        return np.where(exact[..., None], wanted, near), held


def fits_above(
    floor: Floor | None, fits: WindowFits, workspace: Workspace
) -> Iterator[FittedFrames]:
    """Fit the frames above a floor.

    Vertices that pass it become contacts of all frames, and the frames are fitted again from where
    they are, before any is yielded. What is left is projected onto the floor.

    Args:
        floor: the floor, or None.
        fits: of the frames.
        workspace: where shapes are while frames may be fitted again.
    """
    if floor is None:
        yield from fits.run(0, None, [], None)
        return
    reference, F = fits.basis.model.reference, len(fits.tracks)
    contacts = FloorContacts(reference.vertices, reference.bounding_diagonal)
    shapes = workspace.doubles((F, len(reference.vertices), 3))
    X, steps = workspace.doubles((F, fits.energy.size)), 0
    for attempt in range(_FLOOR_ROUNDS + 1):
        depths = np.full(len(reference.vertices), -np.inf)
        known = X if attempt else None
        for part in fits.run(attempt, floor, contacts.vertices, known):
            shapes[part.frames], X[part.frames] = part.shapes, part.X
            steps += part.steps
            np.maximum(depths, floor.depths(part.shapes).max(axis=0), out=depths)
        if attempt == _FLOOR_ROUNDS or not contacts.add(depths):
            break
    for frames in slices(F, _SHAPES):
        above = floor.above(shapes[frames])
        yield FittedFrames(frames, np.array(X[frames]), above, 0 if frames.start else steps)


def _handle_positions(batch: Frames, energy: HandleEnergy, X: FloatArray) -> FloatArray:
    """Positions (m, H, 3) of handles by unknowns X (m, K+6) alone."""
    Q = log_to_rotation(Unknowns(X).rotation)
    return batch.by_all(energy.codes(X)) @ Q.transpose(0, 2, 1) + energy.centroids(X)[:, None]


def _backend(basis: HandleBasis, device: str, backend: str | None) -> Frames:
    """`Frames` of a backend on a device; see `fit_sequence`."""
    if device == "auto" and (backend == "numba" or not basis.model.decoder.pointwise):
        device = "cpu"  # torch knows networks of one layer only
    if device != "cpu":
        device = str(resolve_device(device))
    if backend == "torch" or (backend is None and device != "cpu"):
        # torch takes seconds to import.
        from deformer.editing.batch_torch import TorchFrames

        return TorchFrames(basis, device)
    if device != "cpu":
        raise InputError(f"backend 'numba' computes on the CPU, got device {device!r}; use 'torch'")
    return NumbaFrames(basis)
