"""`deformer rig`: a model's bones and weights, their file and their summary."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import deformer
from deformer import io
from deformer_app import console


def run(
    model_name: str, output: Path, bones: int, influences: int, fps: float, bare: bool
) -> dict[str, Any]:
    """Make a rig and write it.

    Args:
        model_name: name of a shipped model, or a path.
        output: GLB file.
        bones: most bones.
        influences: most bones that move a vertex.
        fps: training shapes a second in the clip.
        bare: write nothing of the model's document.

    Returns:
        Numbers of the rig, its bones by name, and the file.

    Raises:
        InputError: an output that cannot be written, or what `deformer.rig` refuses.
    """
    if output.suffix.lower() != ".glb":
        raise deformer.InputError(
            f"{output}: got suffix {output.suffix!r}, expected .glb; choose another name"
        )
    io.check_output_file(output)
    model = deformer.load_model(model_name)
    with console.progress("rigging") as report:
        rig = deformer.rig(model, bones, influences, on_progress=report)
    up = model.up
    rig.save(output, fps, like=None if bare else model, up=up)
    names = rig.names
    return {
        "model": model_name,
        "bones": len(names),
        "asked": bones,
        "influences": rig.influences,
        "E_rms": rig.error,
        "E_rms_share": rig.error / 1000.0 / model.reference.bounding_diagonal,
        "stray_share": rig.stray,
        "joint_gap": rig.joint_gap,
        "frames": len(rig.clip),
        "fps": fps,
        "skeleton": [
            {"name": name, "parent": names[parent] if parent >= 0 else None, "joint": joint}
            for name, parent, joint in zip(
                names, rig.parents.tolist(), rig.rest[:, :3, 3].tolist(), strict=True
            )
        ],
        "files": [output],
    }


def show(result: dict[str, Any]) -> None:
    """Print the result of `run`."""
    if result["bones"] < result["asked"]:
        console.note(
            f"{result['bones']} bones, {result['asked']} were asked for: one more would move "
            "hardly a vertex, or nothing is left for it to explain"
        )
    console.out.print(
        f"{result['bones']} bones, at most {result['influences']} a vertex: E_rms "
        f"{console.brief(result['E_rms'])} over {result['frames']} training shapes as the model "
        f"decodes them ({100 * result['E_rms_share']:.2g} % of the bounding diagonal), "
        f"{100 * result['stray_share']:.2g} % of the weights astray",
        soft_wrap=True,
        markup=False,
    )
    console.note(f"Saved {result['files'][0]}.")
