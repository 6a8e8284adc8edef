"""An area that scrolls sideways where it is narrower than what it shows, and says so by a bar."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QWidget


class HorizontalScroll(QScrollArea):
    """Shows a widget of any width; its minimum height is the widget's, above the scroll bar.

    Args:
        widget: what is shown.
    """

    def __init__(self, widget: QWidget) -> None:
        """Show the widget."""
        super().__init__()
        self._shown = widget
        self.setWidgetResizable(True)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # Tab goes on to what is in it
        self.setWidget(widget)

    def sizeHint(self) -> QSize:
        """Return the widget's, above the scroll bar if there is one."""
        return self._shown.sizeHint() + QSize(0, self._bar_height())

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size; only its height depends on the widget."""
        height = self._shown.minimumSizeHint().height() + self._bar_height()
        return QSize(super().minimumSizeHint().width(), height)

    def _bar_height(self) -> int:
        narrow = self.width() < self._shown.minimumSizeHint().width()
        return self.horizontalScrollBar().sizeHint().height() if narrow else 0

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Tell the layout that has this area when the scroll bar may come or go."""
        super().resizeEvent(event)
        self.updateGeometry()

    def viewportEvent(self, event: QEvent) -> bool:
        """Tell the layout that has this area when the widget's smallest size may have changed."""
        if event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().viewportEvent(event)
