"""The humanoid training set: body, rig and poses behind `01_make_humanoid.py`."""
