"""Which of two faces at about the same depth is seen."""

from __future__ import annotations

from vtkmodules.vtkRenderingCore import vtkMapper


def offset_depth(mapper: vtkMapper, slope: float, units: float) -> None:
    """Draw a mapper's faces as if they were farther away, or nearer where the numbers are negative.

    VTK has one mode for all mappers of the process, which comes with offsets for all of them: with
    its own, balls behind the surface would be seen. They are zero here but for this mapper's.

    Args:
        mapper: of faces.
        slope: offset in changes of the depth from one pixel to the next.
        units: offset in parts of the depth, of which there are 65,536.
    """
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetResolveCoincidentTopologyPolygonOffsetParameters(0.0, 0.0)
    mapper.SetResolveCoincidentTopologyLineOffsetParameters(0.0, 0.0)
    mapper.SetResolveCoincidentTopologyPointOffsetParameter(0.0)
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(slope, units)
