"""Settings of trainings that several tests share."""

from deformer.network.config import AdamSettings

# Adam from principal components, with mixed shapes, by batches: close to its best soon.
QUICK_ADAM = AdamSettings(
    epochs=5,
    sparsity=2.0,
    learning_rate=3e-3,
    schedule="cosine",
    batch=16,
    mixed_shapes=2,
    initial="pca",
    pruning=0.01,
)
