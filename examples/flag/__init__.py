"""The flag set: cloth, wind, noise and checks behind the examples 10 and 11."""
