"""Models on disk that are changed together with their checksums."""

import hashlib
import json

from safetensors.numpy import load_file, save_file


def sign(folder, data):
    """Renew the checksums in the description `data` of a model, where it has any."""
    sums = data.get("sha256")
    if not isinstance(sums, dict):
        return
    for name in ("reference.ply", "weights.safetensors"):
        if name in sums:
            sums[name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    if "model.json" in sums:
        rest = {name: digest for name, digest in sums.items() if name != "model.json"}
        text = json.dumps({**data, "sha256": rest}, sort_keys=True)
        sums["model.json"] = hashlib.sha256(text.encode()).hexdigest()


def change_description(folder, change):
    """Apply `change` to the description of a model, and sign it."""
    path = folder / "model.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    sign(folder, data)
    path.write_text(json.dumps(data), encoding="utf-8")


def change_tensors(folder, change):
    """Apply `change` to the arrays of a model by name, and sign it."""
    path = folder / "weights.safetensors"
    arrays = load_file(path)
    change(arrays)
    save_file(arrays, path)
    change_description(folder, lambda data: None)
