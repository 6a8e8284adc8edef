"""Names that the user gives to components, stored with the session and with the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import deformer
from deformer import DeformationModel, InputError

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor


def component_title(model: DeformationModel, component: int) -> str:
    """Return a component's name as it was typed, or "Component 3"."""
    label = model.label(component)
    return label if component in model.component_names else label.capitalize()


def with_session_names(model: DeformationModel, names: Mapping[int, str]) -> DeformationModel:
    """Return a copy with a session's names for components, an empty one for none.

    A name that the model has by now for another component is the session's.

    Raises:
        InputError: names that are none, or of no component.
    """
    taken = {name.strip() for name in names.values()}
    lost = {k: "" for k, name in model.component_names.items() if name in taken}
    return model.with_component_names({**lost, **names})


def rename_component(editor: Editor, component: int, name: str) -> None:
    """Name a component in the session, and in the model's files if they can be written.

    Args:
        editor: the model and its session.
        component: index k.
        name: an empty one removes the component's name.

    Raises:
        InputError: no name, or another component has it.
    """
    if name.strip() == editor.model.component_names.get(component, ""):
        return
    editor.name_components({component: name})
    path = editor.session.model.path
    if path in deformer.shipped_models():
        return
    try:
        deformer.save_names(path, {component: name})
    except (InputError, OSError) as error:
        editor.note(f"The session has the name, but not the model: {error}")
