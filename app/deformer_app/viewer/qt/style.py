"""The style sheet of all widgets: spacing, borders, and where the keyboard is."""

from __future__ import annotations

from pathlib import Path

from deformer_app.rendering.palette import NOTICE, Theme

_ICONS = Path(__file__).with_name("icons").as_posix()
# Qt (6.11) takes a combo box's padding-top for the margin of its list: the same with and without
# the focus, or a list that was laid out without it is cut by the difference.
_SHEET = """
QToolTip {{ color: {ink}; background: {base}; border: 1px solid {line}; padding: 4px 6px; }}
QMainWindow::separator {{ background: {line}; width: 1px; height: 1px; }}
QMainWindow::separator:hover {{ background: {accent}; }}

QMenuBar {{ background: {window}; border-bottom: 1px solid {line}; padding: 2px 6px; }}
QMenuBar::item {{ padding: 4px 10px; border-radius: 4px; background: transparent; }}
QMenuBar::item:selected {{ background: {raised}; }}
QMenu {{ background: {base}; border: 1px solid {line}; padding: 5px 0; }}
QMenu::item {{ padding: 5px 26px 5px 10px; margin: 0 5px; border-radius: 4px; }}
QMenu::item:selected {{ background: {accent}; color: {upon}; }}
QMenu::item:disabled {{ color: {disabled}; background: transparent; }}
QMenu::icon {{ padding-left: 6px; }}
QMenu::separator {{ height: 1px; background: {line}; margin: 5px 0; }}

QToolBar {{ background: {window}; border: none; border-bottom: 1px solid {line}; padding: 4px 8px;
    spacing: 2px; }}
QToolBar::separator {{ background: {line}; width: 1px; margin: 4px 6px; }}
QToolButton {{ border: 1px solid transparent; border-radius: 5px; padding: 4px 7px;
    background: transparent; }}
QToolButton:hover {{ background: {raised}; }}
QToolButton:pressed {{ background: {line}; }}
QToolButton:checked {{ background: {raised}; border-bottom: 2px solid {accent};
    padding-bottom: 3px; }}
QToolButton:focus {{ border: 2px solid {accent}; padding: 3px 6px; }}
QToolButton[narrow="true"] {{ padding: 4px 3px; }}
QToolButton[narrow="true"]:checked {{ padding-bottom: 3px; }}
QToolButton[narrow="true"]:focus {{ padding: 3px 2px; }}
QToolButton#qt_toolbar_ext_button {{ padding: 0; }}
QToolButton:disabled {{ color: {disabled}; }}

QDockWidget {{ titlebar-close-icon: none; titlebar-normal-icon: none; font-weight: 600; }}
QDockWidget::title {{ background: {window}; padding: 7px 10px; border-bottom: 1px solid {line}; }}
QDockWidget QWidget {{ font-weight: 400; }}

QPushButton {{ border: 1px solid {line}; border-radius: 5px; padding: 5px 12px; min-height: 17px;
    background: {button}; }}
QPushButton:hover {{ background: {raised}; }}
QPushButton:pressed {{ background: {line}; }}
QPushButton:checked {{ background: {accent}; color: {upon}; border-color: {accent}; }}
QPushButton:default {{ background: {accent}; color: {upon}; border-color: {accent}; }}
QPushButton:focus {{ border: 2px solid {accent}; padding: 4px 11px; }}
QPushButton:checked:focus, QPushButton:default:focus {{ border-color: {ink}; }}
QPushButton[narrow="true"] {{ padding: 3px 6px; }}
QPushButton[narrow="true"]:focus {{ padding: 2px 5px; }}
QPushButton:disabled {{ color: {disabled}; background: {window}; border-color: {line}; }}

QLineEdit {{ border: 1px solid {line}; border-radius: 5px; padding: 4px 6px;
    background: {base}; selection-background-color: {accent}; }}
QLineEdit:focus {{ border: 2px solid {accent}; padding: 3px 5px; }}
QLineEdit:disabled {{ color: {disabled}; background: {window}; }}

QAbstractSpinBox, QComboBox {{ border: 1px solid {line}; border-radius: 5px;
    padding: 2px 3px 2px 12px; min-height: 18px; background: {base};
    selection-background-color: {accent}; }}
QComboBox {{ background: {button}; min-height: 20px; padding: 1px 3px 1px 8px; }}
QAbstractSpinBox:focus, QComboBox:focus {{ border: 2px solid {accent};
    padding: 1px 2px 1px 11px; }}
QComboBox:focus {{ padding-left: 7px; min-height: 18px; }}
QAbstractSpinBox:disabled, QComboBox:disabled {{ color: {disabled}; background: {window}; }}
QAbstractSpinBox::up-button, QAbstractSpinBox::down-button {{ subcontrol-origin: border;
    width: 16px; border: none; background: transparent; }}
QAbstractSpinBox::up-button {{ subcontrol-position: top right; }}
QAbstractSpinBox::down-button {{ subcontrol-position: bottom right; }}
QAbstractSpinBox::up-button:hover, QAbstractSpinBox::down-button:hover {{ background: {raised}; }}
QAbstractSpinBox::up-arrow {{ image: url({icons}/chevron-up.svg); width: 9px; height: 9px; }}
QAbstractSpinBox::down-arrow {{ image: url({icons}/chevron-down.svg); width: 9px; height: 9px; }}
QAbstractSpinBox[bare="true"] {{ padding-right: 0; }}
QAbstractSpinBox[bare="true"]::up-button, QAbstractSpinBox[bare="true"]::down-button,
QAbstractSpinBox[bare="true"]::up-arrow, QAbstractSpinBox[bare="true"]::down-arrow {{ width: 0; }}
QComboBox::drop-down {{ subcontrol-origin: border; subcontrol-position: center right; width: 20px;
    border: none; }}
QComboBox::down-arrow {{ image: url({icons}/chevron-down.svg); width: 11px; height: 11px; }}
QComboBox QAbstractItemView {{ border: 1px solid {line}; background: {base};
    selection-background-color: {accent}; selection-color: {upon}; }}

QCheckBox {{ spacing: 6px; }}
QCheckBox::indicator {{ width: 13px; height: 13px; border: 1px solid {muted}; border-radius: 3px;
    background: {base}; }}
QCheckBox::indicator:hover, QCheckBox::indicator:focus {{ border-color: {accent}; }}
QCheckBox::indicator:checked {{ background: {accent}; border-color: {accent};
    image: url({icons}/check.svg); }}
QCheckBox::indicator:disabled {{ border-color: {line}; background: {window}; }}

QSlider {{ min-height: 20px; }}
QSlider::groove:horizontal {{ height: 4px; border-radius: 2px; background: {line}; }}
QSlider::sub-page:horizontal {{ height: 4px; border-radius: 2px; background: {accent}; }}
QSlider::handle:horizontal {{ width: 12px; height: 12px; margin: -5px 0; border-radius: 7px;
    background: {base}; border: 1px solid {muted}; }}
QSlider::handle:horizontal:hover {{ border-color: {accent}; }}
QSlider::handle:horizontal:focus {{ border: 2px solid {accent}; margin: -6px 0; }}
QSlider::sub-page:horizontal:disabled {{ background: {line}; }}

QProgressBar {{ border: none; border-radius: 3px; background: {line}; text-align: center; }}
QProgressBar::chunk {{ border-radius: 3px; background: {accent}; }}

QTableView {{ background: {base}; alternate-background-color: {alternate}; gridline-color: {line};
    border: 1px solid {line}; border-radius: 5px; }}
QTableView:focus, QListView:focus {{ border: 2px solid {accent}; }}
QTableView::item {{ padding: 2px 6px; }}
QTableView::item:selected {{ background: {accent}; color: {upon}; }}
QHeaderView::section {{ background: {window}; color: {muted}; border: none;
    border-bottom: 1px solid {line}; padding: 4px 6px; }}

QScrollArea {{ border: none; }}
QScrollBar:vertical {{ background: transparent; width: 10px; margin: 0; }}
QScrollBar:horizontal {{ background: transparent; height: 10px; margin: 0; }}
QScrollBar::handle {{ background: {faint}; border-radius: 3px; min-height: 24px; min-width: 24px;
    margin: 2px; }}
QScrollBar::handle:hover {{ background: {muted}; }}
QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
QScrollBar::add-page, QScrollBar::sub-page {{ background: transparent; }}

QTabWidget::pane {{ border: none; border-top: 1px solid {line}; }}
QTabBar::tab {{ padding: 6px 12px; border: none; border-bottom: 2px solid transparent; }}
QTabBar::tab:selected {{ border-bottom-color: {accent}; }}
QTabBar::tab:hover {{ background: {raised}; }}
QTextBrowser {{ border: none; background: {base}; padding: 6px; }}

QStatusBar {{ background: {window}; border-top: 1px solid {line}; color: {muted}; }}
QStatusBar QLabel {{ color: {muted}; padding: 2px 6px; }}
QStatusBar::item {{ border: none; }}

QDialogButtonBox, QMessageBox {{ dialogbuttonbox-buttons-have-icons: 0; }}

QLabel[rank="title"] {{ font-size: 20pt; font-weight: 600; }}
QLabel[rank="heading"] {{ font-size: 12pt; font-weight: 600; }}
QLabel[rank="second"] {{ color: {muted}; }}
QToolButton[card="true"] {{ background: {base}; border: 1px solid {line}; border-radius: 8px;
    padding: 10px; }}
QToolButton[card="true"]:hover {{ border-color: {accent}; background: {raised}; }}
QToolButton[card="true"]:focus {{ border: 2px solid {accent}; padding: 9px; }}

QWidget[notice] {{ background: {base}; border: 1px solid {line}; border-left-width: 4px;
    border-radius: 6px; }}
QWidget[notice] QLabel {{ border: none; background: transparent; }}
"""


def stylesheet(theme: Theme) -> str:
    """Return the style sheet of a theme."""
    sheet = _SHEET.format(
        ink=theme.widget("WindowText"),
        window=theme.widget("Window"),
        base=theme.widget("Base"),
        alternate=theme.widget("AlternateBase"),
        button=theme.widget("Button"),
        upon=theme.widget("HighlightedText"),
        line=theme.line,
        faint=theme.widget("PlaceholderText"),
        muted=theme.muted,
        raised=theme.raised,
        accent=theme.accent,
        disabled=theme.disabled,
        icons=_ICONS,
    )
    edges = (
        f'QWidget[notice="{kind}"] {{ border-left-color: {colour}; }}'
        for kind, colour in NOTICE.items()
    )
    return sheet + "\n".join(edges)
