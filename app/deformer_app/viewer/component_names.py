"""Names that the user gives to components, stored with the session and with the model."""

from __future__ import annotations

import deformer
from deformer import DeformationModel, InputError
from deformer_app.viewer.editor import Editor


def component_title(model: DeformationModel, component: int) -> str:
    """Return a component's name as it was typed, or "Component 3"."""
    label = model.label(component)
    return label if component in model.component_names else label.capitalize()


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
