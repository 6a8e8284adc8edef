"""The hand training set: rig, poses and checks behind `13_make_hand.py`."""
