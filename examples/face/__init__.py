"""The face training set: expressions, their mixtures and a smaller mesh for `12_make_face.py`."""
