from .autoencoder import Autoencoder as Autoencoder
from .edges import EdgeSplocs as EdgeSplocs
from .linear_components import LinearComponents as LinearComponents
from .method import ComponentMethod as ComponentMethod, PosingMethod as PosingMethod
from .registry import METHODS as METHODS
