"""Where things are that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Example meshes that are not part of the project; tests that use them skip where they are absent.
DATA = ROOT.parent / "shared" / "data"
