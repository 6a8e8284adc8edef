"""What the fields of numbers do to an editor once a number has been typed."""


def type_centre(editor, centre):
    """Move the selected handles so that their common centre is at a point (3,)."""
    editor.handles.slide_centre(centre)
    editor.commit("Move")


def type_height(editor, height):
    """Move the floor to a height."""
    editor.floor.slide(height)
    editor.commit("Floor")
