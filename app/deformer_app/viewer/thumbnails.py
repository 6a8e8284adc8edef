"""Small pictures of sessions, for recent files and for recovery."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from PIL import Image

import deformer
from deformer import io
from deformer_app.viewer.editor import Editor

SIZE = (240, 180)  # pixels


def save_thumbnail(editor: Editor, path: Path) -> None:
    """Write the middle of the picture as a PNG of `SIZE`."""
    whole = Image.fromarray(editor.state.view.grab())
    width, height = whole.size
    scale = min(width / SIZE[0], height / SIZE[1])
    across, down = min(scale * SIZE[0], width), min(scale * SIZE[1], height)
    left, top = (width - across) / 2, (height - down) / 2
    part = (left, top, left + across, top + down)
    with io.atomic_path(path) as temporary:
        whole.resize(SIZE, Image.Resampling.LANCZOS, part, reducing_gap=2.0).save(temporary, "PNG")


def shipped_pictures() -> dict[str, bytes | None]:
    """Return the picture (a PNG file) of each shipped model by its name; None without one."""
    root, found = resources.files("deformer_models"), {}
    for name in deformer.shipped_models():
        picture = root / name / "picture.png"
        found[name] = picture.read_bytes() if picture.is_file() else None
    return found
