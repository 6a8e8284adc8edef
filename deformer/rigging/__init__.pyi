from .decomposition import rig as rig
from .rigs import Rig as Rig
