"""The timeline of an editor: commands on keys, the playhead, and the fitted clip that it shows.

Keys are part of the session's history, the playhead is not. The state of the playhead's frame takes
the place of the state of the shown step: a handle that has keys is where they put it, and what was
dragged without a key is gone once the playhead moves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deformer import io
from deformer_app.viewer.changes import (
    Change,
    HandlesDragged,
    HistoryChanged,
    MistakeMade,
    ModelOpened,
    PlaybackBegun,
    StepShown,
)
from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.timeline.clip_job import ClipJob, FittedClip, Request
from deformer_app.viewer.timeline.key_commands import KeyCommands
from deformer_app.viewer.timeline.keys import (
    LONGEST,
    NO_KEYS,
    SLIDERS,
    Clip,
    Key,
    KeyName,
    Placement,
    Track,
    changed_owners,
    continued,
    keys_of,
    placed,
)
from deformer_app.viewer.timeline.loaded_meshes import LoadedMeshes
from deformer_app.viewer.timeline.onion import Onion
from deformer_app.viewer.timeline.playback import Playback
from deformer_app.viewer.timeline.skins import Skins
from deformer_app.viewer.timeline.steps import change_clip, solve_shown
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_SETTLED = 0.25  # seconds after a change until the clip is fitted, or the playhead's pose solved


class Timeline:
    """Keys, playhead and playback of an editor's clip.

    Args:
        editor: the editor; the timeline listens to it and has its states keyed.

    Attributes:
        clock: gives the time in seconds.
        on_change: called after every change of keys, playhead, playback, fit or options.
        auto_key: true to key what a step changes, once the clip has keys.
        loop: true to play again and again.
        onion: which onion skins are shown.
        selected: names of the selected keys.
        keys: sets, moves and changes keys.
        loaded: posed meshes that were loaded, shown translucently; None without.
    """

    def __init__(self, editor: Editor) -> None:
        """Listen to the editor."""
        self.clock: Callable[[], float] = time.monotonic
        self.on_change: list[Callable[[], Any]] = []
        self.auto_key, self.loop = True, True
        self.onion = Onion()
        self.selected: frozenset[KeyName] = frozenset()
        self.loaded: LoadedMeshes | None = None
        self.keys = KeyCommands(self, editor)
        self._editor, self._skins = editor, Skins(editor.state.view.ghosts)
        self._playback: Playback | None = None
        self._fitted: FittedClip | None = None
        self._job: ClipJob | None = None
        self._failed: Request | None = None
        self._planned = self._settling = False
        self._moved_at = 0.0
        editor.on_change.append(self._hear)

    def begin(self, view: io.JsonValue) -> None:
        """Begin with the meshes that a session's view names; they are loaded in the background.

        Raises:
            InputError: their entry is damaged.
        """
        known = "sequence" in view and view["sequence"].value is not None
        self.loaded = LoadedMeshes.read(view["sequence"]) if known else None
        if self.loaded is not None:
            self._editor.run(self._load(self.loaded))

    def _load(self, wanted: LoadedMeshes) -> Iterator[None]:
        model = self._editor.model
        found, message = yield from in_background(lambda: wanted.restored(model))
        if self.loaded is not wanted:
            return
        self.loaded = found
        if message:
            self._editor.announce(MistakeMade(message))
        self.tell()

    @property
    def footage(self) -> NDArray[np.float64] | None:
        """The loaded meshes (F, V, 3), if there are any."""
        return None if self.loaded is None else self.loaded.shapes

    # The clip and its playhead.

    @property
    def clip(self) -> Clip:
        """The keys of the shown step."""
        return self._editor.session.clip if self._editor.is_open else NO_KEYS

    @property
    def frame(self) -> int:
        """The playhead."""
        return self._editor.session.frame if self._editor.is_open else 0

    @property
    def fitted(self) -> FittedClip | None:
        """The fitted clip, if it is that of the present keys and handles."""
        if self._fitted is None or self._fitted.request != self._request():
            return None
        return self._fitted

    @property
    def progress(self) -> tuple[int, int] | None:
        """Numbers of frames fitted and of all frames, while the clip is being fitted."""
        return self._job.progress if self._job is not None else None

    @property
    def rows(self) -> list[tuple[int, str]]:
        """Owners of keys and their names: the sliders, handles, and deleted handles with keys."""
        if not self._editor.is_open:
            return []
        names = self._editor.handles.names
        return [(SLIDERS, "Sliders"), *((h.id, names.of(h)) for h in self._editor.edit.handles)]

    def tell(self) -> None:
        """Call the listeners of `on_change`, and draw the onion skins that are shown now."""
        if self._skins.update(self):
            self._editor.state.invalidate()
        for listener in tuple(self.on_change):
            listener()

    def seek(self, frame: int) -> None:
        """Move the playhead, at most to the last frame, and show the frame; not during a drag."""
        if not self._editor.is_open or self._editor.session.under_way:
            return
        self._editor.session.frame = max(0, min(frame, self.clip.length - 1))
        self._editor.state.reference_picture.set_frame(self.frame / self.clip.fps)
        if self.clip.tracks:
            self._show()
        self.tell()

    def _show(self) -> None:
        """Show the frame of the playhead: its fitted shape, or a live pose of its handles."""
        editor, fitted = self._editor, self.fitted
        state = self.clip.at(editor.edit, self.frame)
        shape = None if fitted is None else fitted.vertices[self.frame]
        if state == editor.edit and shape is None:
            return
        editor.show_state(state, shape)
        self._moved_at = self.clock()
        if not self._settling:
            self._settling = True
            editor.run(self._settle())

    def _settle(self) -> Iterator[None]:
        """Have the shown frame solved once the playhead rests, so that a drag starts from it."""
        while self.clock() - self._moved_at < _SETTLED or self.playing:
            yield
        self._settling = False
        editor, fitted = self._editor, self.fitted
        if editor.is_open and not editor.session.under_way:
            solve_shown(editor, None if fitted is None else fitted.solution(self.frame))

    def step(self, frames: int) -> None:
        """Move the playhead by frames."""
        self.stop()
        self.seek(self.frame + frames)

    def go_to_key(self, step: int) -> None:
        """Move the playhead to the next key (1) or the one before (−1), if there is one."""
        frame = self.clip.next_key(self.frame, step)
        if frame is not None:
            self.stop()
            self.seek(frame)

    # Playback.

    @property
    def playing(self) -> bool:
        """True while the clip plays."""
        return self._playback is not None

    def play(self) -> None:
        """Play from the playhead, or from the beginning where it is at the end."""
        if self.playing or not self._editor.is_open:
            return
        clip, first = self.clip, self.frame
        first = 0 if first == clip.length - 1 else first
        self._playback = Playback(first, self.clock(), clip.fps, clip.length, self.loop)
        self._editor.run(self._play(self._playback))
        self._editor.announce(PlaybackBegun())
        self.tell()

    def stop(self) -> None:
        """Stop the playback where it is."""
        if self.playing:
            self._playback = None
            self.tell()

    def play_or_stop(self) -> None:
        """Play, or stop what plays."""
        (self.stop if self.playing else self.play)()

    def set_loop(self, loop: bool) -> None:
        """Play again and again, or once."""
        self.loop = loop
        self._restart()

    def _restart(self) -> None:
        """Go on with the playback from the playhead, with the present options."""
        if self.playing:
            self._playback = None
            self.play()
        else:
            self.tell()

    def _play(self, playback: Playback) -> Iterator[None]:
        while self._playback is playback:
            now = self.clock()
            if self._editor.session.under_way:
                self.stop()
                return
            frame = playback.frame(now)
            if frame != self.frame:
                self.seek(frame)
            if playback.ended(now):
                self.stop()
                return
            yield

    # Changes.

    def set_clip(self, **changes: Any) -> None:
        """Change the length (frames), the rate (fps) or the smoothness of the clip."""
        clip = replace(self.clip, **changes)
        last = max((frame for _, frame in clip.names), default=0)
        clip = replace(clip, length=max(1, last + 1, min(clip.length, LONGEST)))
        self.change("Clip", clip)
        self._restart()

    def set_onion(self, **changes: Any) -> None:
        """Change the onion skins, see `Onion`."""
        self.onion = replace(self.onion, **changes)
        self.tell()

    def change(self, label: str, clip: Clip) -> None:
        """Make a clip the next step of the history and show the playhead's frame of it."""
        if change_clip(self._editor, label, clip):
            self.seek(self.frame)

    def keyed(self, before: Edit, after: Edit, whole: bool = False) -> Clip:
        """The clip that goes with a step from one state to another: keyed, if auto-key is on.

        Keys are for what has changed; of a `whole` pose for all of it, so that later changes at
        other frames do not reach it.
        New handles get a key at the other frames that have keys, too, where the shapes are that
        were fitted last: one key alone would pull at all frames.
        """
        clip = self.clip.with_keys(self._reshaped(before, after))
        if not (self.auto_key and clip.tracks):
            return clip
        known = {handle.id for handle in before.handles}
        new = [handle for handle in after.handles if handle.id not in known]
        changed = changed_owners(before, after)
        owners = [SLIDERS, *(handle.id for handle in after.handles)] if whole else changed
        keys = keys_of(after, self.frame, owners)
        return clip.with_keys(continued(clip, [*self._elsewhere(new), *keys]))

    def _reshaped(self, before: Edit, after: Edit) -> list[tuple[int, Key]]:
        """The keys of handles that have other vertices now, as a pin of another size has.

        Keys tell places of the vertices of before, where those of now would be pulled to.
        """
        vertices = {handle.id: handle.vertices for handle in before.handles}
        found = []
        for handle in after.handles:
            track = self.clip.track(handle.id)
            if track is None or vertices.get(handle.id, handle.vertices) == handle.vertices:
                continue
            for key in track.keys:
                there = handle if key.frame == self.frame else self._at_key(handle, key, track)
                found.append((handle.id, replace(key, value=Placement.of(there))))
        return found

    def _at_key(self, handle: Handle, key: Key, track: Track) -> Handle:
        """A handle with other vertices than its key's: on the shape fitted there, if there is one.

        Otherwise it is where the key has the first vertex; a measured one always.
        """
        fitted = self._fitted
        if fitted is None or track.measured or key.frame >= len(fitted.vertices):
            assert isinstance(key.value, Placement)
            return placed(handle, key.value.of_first_vertex)
        return fitted.on_surface(self._editor.model, handle, key.frame)

    def _elsewhere(self, handles: Sequence[Handle]) -> list[tuple[int, Key]]:
        """Keys of handles at the frames of other keys, on the shapes there; none without shapes."""
        fitted = self._fitted
        if fitted is None or not handles:
            return []
        model = self._editor.model
        return [
            (handle.id, Key(frame, Placement.of(fitted.on_surface(model, handle, frame))))
            for frame in self.clip.posed_frames
            if self.frame != frame < len(fitted.vertices)
            for handle in handles
        ]

    @property
    def has_shapes(self) -> bool:
        """True once a clip has been fitted, whether or not keys have changed since."""
        return self._fitted is not None

    # The fit.

    def _request(self) -> Request | None:
        """What the present keys and handles would be fitted to; None without keys."""
        if not self._editor.is_open or not self.clip.tracks:
            return None
        return Request.of(self.clip, self._editor.edit)

    def _hear(self, change: Change) -> None:
        match change:
            case ModelOpened():
                self._cancel()
                self._skins.forget()
                self._fitted = self._failed = self._playback = None
                self.selected = frozenset()
            case HandlesDragged():
                self._cancel()
                return
            case StepShown():
                self.seek(self.frame)
            case HistoryChanged():
                pass
            case _:
                return
        self._plan()
        self.tell()

    def _cancel(self) -> None:
        if self._job is not None:
            self._job.cancel()

    def _plan(self) -> None:
        """Fit the clip once the editor rests, unless it is fitted already."""
        if self._job is not None and self._job.request != self._request():
            self._cancel()
        if not self._planned and self._request() is not None:
            self._planned = True
            self._editor.run(self._fit())

    def _fit(self) -> Iterator[None]:
        """Fit the clip until the fit is that of the present keys; while a drag goes on, wait."""
        changed, wanted = self.clock(), self._request()
        try:
            while True:
                if self._editor.session.under_way:  # a drag must not wait for anything here
                    changed = self.clock()
                    yield
                    continue
                latest = self._request()
                if latest != wanted:
                    wanted, changed = latest, self.clock()
                if wanted is None or self.fitted is not None or wanted == self._failed:
                    break
                if self.clock() - changed < _SETTLED:
                    yield
                else:
                    yield from self._run_job(ClipJob(self._editor.model, wanted))
        finally:
            self._planned = False
        self.tell()
        fitted = self.fitted
        if fitted is not None and not self.playing and not self._editor.session.under_way:
            solve_shown(self._editor, fitted.solution(self.frame))

    def _run_job(self, job: ClipJob) -> Iterator[None]:
        """Wait for a fit and show its progress; end it once it is no longer wanted."""
        self._job, told = job, job.progress
        try:
            self.tell()
            while not job.done:
                yield
                if self._editor.session.under_way or job.request != self._request():
                    job.cancel()
                if told != job.progress:
                    told = job.progress
                    self.tell()
        finally:
            self._job = None
        if job.result is not None:
            self._fitted = job.result
        if job.error is not None:
            self._failed = job.request
            self.tell()
            raise job.error

    @property
    def waiting(self) -> bool:
        """True while a fit of the present keys is going on or about to begin."""
        return self._planned

    def refit(self) -> None:
        """Fit the clip unless it is fitted, even if that was cancelled or has failed."""
        self._failed = None
        self._plan()

    def cancel_fit(self) -> None:
        """Stop the fit that goes on; the next change of a key starts another."""
        if self._job is not None:
            self._failed = self._job.request
            self._job.cancel()
            self.tell()

    def close(self, seconds: float = 5.0) -> None:
        """Stop playback and fit; wait at most so long for the fit's thread."""
        self._playback = None
        if self._job is not None:
            self._job.cancel()
            self._job.join(seconds)
