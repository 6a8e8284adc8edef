"""The command `deformer`: one file a command."""
