"""The viewer, independent of Qt: state of an editor, its commands and its picture."""
