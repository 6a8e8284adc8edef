"""Components in pieces: what they tell is not kept."""

import weakref

import numpy as np

from deformer.training import site_pieces
from deformer.training.site_tiles import SiteTiles
from deformer.training.sparse_components import Factorisation, LocalisedSettings
from deformer.workspace import Workspace


def tiles(shapes=40, sites=30):
    """Numbers in tiles of two sites."""
    values = np.random.default_rng(0).normal(size=(shapes, sites, 3))
    made = SiteTiles(values.shape, values.dtype, Workspace(), width=2)
    made.write(0, values)
    return made


def test_sums_are_kept_once_and_not_for_each_tile(monkeypatch):
    """Of many shapes, sums are larger than a tile: 8,000 shapes would take gigabytes."""
    kept, sums_of = [], site_pieces.sums_of

    def watched(*arguments):
        found = sums_of(*arguments)
        kept.append(weakref.ref(found.against))
        return found

    monkeypatch.setattr(site_pieces, "sums_of", watched)
    data = tiles()
    problem = Factorisation(data, lambda _: np.linspace(0, 1, 30), 4, LocalisedSettings())
    problem.start()
    assert len(kept) == data.count
    assert not any(one() is not None for one in kept)
