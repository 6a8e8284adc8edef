"""The Deformer application: command line, pictures, demo. Numerics live in `deformer`."""
