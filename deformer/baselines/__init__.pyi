from .autoencoder import Autoencoder as Autoencoder
from .edges import EdgeSplocs as EdgeSplocs
from .linear_components import LinearComponents as LinearComponents
from .method import Method as Method, Poser as Poser
from .registry import METHODS as METHODS
