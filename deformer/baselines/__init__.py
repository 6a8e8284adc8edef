"""Methods that deform a mesh by examples, or by rigidity alone, behind one protocol."""
