"""`deformer check`: examine shapes, repair copies of them, write a report with pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from deformer import (
    InputError,
    MeshSequence,
    Report,
    StoredShapes,
    Workspace,
    examine,
    io,
    load_shapes,
    repair_shapes,
    sequence_memory,
    training_memory,
)
from deformer_app import console


def file_names(path: Path) -> list[str] | None:
    """The file of each shape; None where one file has all."""
    return [file.name for file in io.shape_files(path)] if path.is_dir() else None


def shape_names(path: Path, shapes: MeshSequence | StoredShapes) -> list[str] | None:
    """What messages call the shapes: their files, or their own names; None without either."""
    files = file_names(path)
    if files is not None and len(files) == len(shapes):
        return files
    return list(shapes.names) or None


def run(
    path: Path,
    fix: Path | None,
    page: Path | None,
    reference: str | None = None,
    fps: float | None = None,
    clip: str | None = None,
    workspace: Workspace | None = None,
) -> dict[str, Any]:
    """Examine shapes, and repair and picture them if asked; what `--json` prints.

    Args:
        path: the shapes.
        fix: directory for repaired copies, or None.
        page: HTML file for a report with pictures, or None.
        reference: the undeformed shape, as of `io.with_reference`; None is the first.
        fps, clip: as of `load_shapes`.
        workspace: where the shapes are, unless they are repaired or pictured: these need memory.
    """
    if fix is not None and reference is not None:
        raise InputError(
            "--fix repairs shapes by the first one, got --reference with it; leave one out"
        )
    if fix is not None:
        io.check_copy(path, fix)
    if page is not None:
        io.check_output_file(page)
    work = workspace or Workspace()
    shapes: MeshSequence | StoredShapes
    with console.progress("loading") as progress:
        if fix is not None or page is not None:
            shapes = load_shapes(path, progress, fps=fps, clip=clip)
        else:
            shapes = load_shapes(path, progress, fps=fps, clip=clip, workspace=work)
    if reference is not None:
        shapes, first = io.with_reference(shapes, reference, work)
        # The examination takes shape 0 as the reference.
        shapes = shapes.subset([first, *(n for n in range(len(shapes)) if n != first)])
    names = shape_names(path, shapes) if reference is None else list(shapes.names) or None
    report = examine(shapes, names)
    result = report.as_dict()
    facts = report.facts
    vertices = facts["vertices"] - facts["seam_vertices"]
    result["memory"] = _memory(len(shapes), vertices, work.limit)
    result["fit_memory"] = _fit_memory(vertices)
    fixed: tuple[MeshSequence, Report] | None = None
    done: tuple[str, ...] = ()
    if fix is not None and isinstance(shapes, MeshSequence):
        repaired = repair_shapes(shapes, names)
        written = io.save_copy(
            path,
            fix,
            repaired.shapes,
            changed=repaired.changed,
            kept=repaired.kept,
            faces_changed=repaired.faces_changed,
        )
        done = repaired.done
        if written:
            done += (
                f"{len(written)} files written anew, e.g. {written[0]}, with positions and "
                "triangles alone",
            )
        # What was written counts, not what should have been.
        copy = io.copied_path(path, fix, len(shapes))
        again = load_shapes(copy)
        fixed = again, examine(again, names)
        result["fix"] = {"output": str(copy), "done": list(done), "after": fixed[1].as_dict()}
        result["usable"] = fixed[1].usable
    if page is not None and isinstance(shapes, MeshSequence):
        from deformer_app.report import check as pages

        pages.write(page, path, shapes, report, done, fixed)
        result["report"] = str(page)
    return result


def _memory(shapes: int, vertices: int, limit: float) -> dict[str, float]:
    """Memory of `deformer train` with 50 components, in GB."""
    expected = training_memory(shapes, vertices)
    sizes = {
        "expected_GB": max(expected.least, min(expected.whole, limit)),
        "all_in_memory_GB": expected.whole,
        "least_GB": expected.least,
        "files_GB": 0.0 if expected.whole <= limit else expected.files,
    }
    return {name: round(size / 1e9, 2) for name, size in sizes.items()}


def _fit_memory(vertices: int) -> dict[str, float]:
    """Memory of `deformer fit` of a sequence with 50 components and 20 handles, in GB."""
    expected = sequence_memory(vertices)
    sizes = {"least_GB": expected.least, "files_GB_of_1000_frames": 1000 * expected.frame}
    return {name: round(size / 1e9, 2) for name, size in sizes.items()}


def show(path: Path, result: dict[str, Any]) -> None:
    """Print what `run` returned."""
    _show_report(str(path), result)
    console.show_facts("Memory of deformer train, with 50 components", result["memory"])
    title = "Memory of deformer fit, for sequences of any length, with 20 handles"
    console.show_facts(title, result["fit_memory"])
    if fix := result.get("fix"):
        rows = [[line] for line in fix["done"]] or [["nothing that can be repaired safely"]]
        console.show_table("Repairs", ["what was done"], rows)
        _show_report(fix["output"], fix["after"])
    if "report" in result:
        console.note(f"Wrote {result['report']}")


def _show_report(title: str, report: dict[str, Any]) -> None:
    console.show_facts(title, report["facts"])
    if report["findings"]:
        rows = [[finding["severity"], finding["message"]] for finding in report["findings"]]
        console.show_table("Findings", ["severity", "message"], rows)
    else:
        console.out.print("No findings.")
