"""Files as documents: what a mesh file has beside positions and triangles, kept in what is written.

The names that other packages may use are listed in `__init__.pyi`; each is loaded when it is
first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
