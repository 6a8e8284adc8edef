"""Pictures as Qt draws them."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QImage, QPixmap

from deformer_app.rendering.offscreen import Picture


def pixmap_of(picture: Picture, density: float = 1.0) -> QPixmap:
    """Return the pixmap of a picture (height, width, 4).

    Args:
        picture: with opacity as the last channel.
        density: its pixels along each side of one that a person sees.
    """
    height, width = picture.shape[:2]
    data = np.ascontiguousarray(picture)
    image = QImage(data.data, width, height, 4 * width, QImage.Format.Format_RGBA8888)
    found = QPixmap.fromImage(image.copy())  # the copy owns its pixels
    found.setDevicePixelRatio(density)
    return found
