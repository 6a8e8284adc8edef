"""Component analysis: the strongest components of the shipped figure, with their names."""

import sys
from pathlib import Path

import deformer
from deformer_app.cli.components import heat_layers, heat_maps, heat_sheet, title
from deformer_app.rendering.sheets import save_sheet


def main(picture: Path, quick: bool = False) -> list[deformer.Component]:
    """Write the picture; returns the components."""
    model = deformer.load_model("humanoid")
    analysis = deformer.ComponentAnalysis(model)
    found = analysis.ranked(2 if quick else 12)

    size = (150, 160) if quick else (400, 480)
    layers = heat_layers(analysis, found)
    pictures = list(heat_maps(layers, up="z", size=size))
    save_sheet(picture, heat_sheet(layers, pictures, 6, [title(c) for c in found]))
    return found


if __name__ == "__main__":
    for c in main(Path(sys.argv[1])):
        print(c.index, c.label, f"{c.strength:.1f}", "extreme in shapes", c.extreme_shapes)
