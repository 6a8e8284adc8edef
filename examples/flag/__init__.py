"""The flag set: cloth, wind, noise and checks behind `10_make_flag.py` and `11_flag_components.py`."""
