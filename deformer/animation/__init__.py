"""Sequences of shapes as files of other programs: morph-target clips, point caches, USD, folders.

The names that other packages may use are listed in `__init__.pyi`; each is loaded when it is
first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
