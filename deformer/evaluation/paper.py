"""The numbers that Tan et al. (AAAI 2018) print, by the method names of this project."""

from __future__ import annotations

# The paper's names of the methods, and this project's.
METHODS = {
    "Ours": "autoencoder-paper",
    "Wang et al.": "splocs-edges",
    "Huang et al.": "splocs-gradients",
    "Neumann et al.": "splocs",
    "Bernard et al.": "structured-factors",
}

# Table "moreevaluation": 50 components, one frame in ten for training. Keys: the paper's data set,
# the data set used here in its place, metric.
_COLUMNS = tuple(METHODS)
MORE_EVALUATION: dict[tuple[str, str, str], dict[str, float]] = {
    key: dict(zip(_COLUMNS, values, strict=True))
    for key, values in {
        ("Horse", "horse", "E_rms"): (12.9605, 29.6090, 18.0624, 7.3682, 20.1994),
        ("Horse", "horse", "STED"): (0.04004, 0.04332, 0.05273, 0.08074, 0.4111),
        ("Face", "face", "E_rms"): (2.9083, 8.5620, 12.3221, 2.9106, 2.9853),
        ("Face", "face", "STED"): (0.007344, 0.01320, 0.01827, 0.008611, 0.02662),
        ("Jumping", "crane", "E_rms"): (24.4827, 44.3362, 37.9915, 29.3368, 49.9374),
        ("Jumping", "crane", "STED"): (0.04862, 0.05400, 0.06305, 0.1268, 0.4308),
        ("Humanoid", "humanoid", "E_rms"): (3.4912, 60.9925, 16.1995, 14.3610, 6.6320),
        ("Humanoid", "humanoid", "STED"): (0.01313, 0.03757, 0.02247, 0.07319, 0.04612),
    }.items()
}

# Table "diff_lambda": E_rms on SCAPE, 50 components, by (λ₁, λ₂).
DIFF_LAMBDA = {
    (0.5, 0.5): 13.556,
    (0.4, 0.4): 14.1763,
    (0.6, 0.6): 13.6429,
    (0.4, 0.6): 14.2645,
    (0.6, 0.4): 14.093,
}

# Figure "gerror" at 50 components, as the paper's text states it: by data set and metric, then
# method. The curves are pictures only; for figure "sparse_control" the text states no number.
GERROR = {
    ("scape", "E_rms"): {"autoencoder-paper": 13.556, "linear-components": 17.1754},
    ("crane", "E_rms"): {"autoencoder-paper": 14.0836, "linear-components": 25.2994},
    ("crane", "STED"): {"autoencoder-paper": 0.03789, "linear-components": 0.05214},
}
GERROR_COMPONENTS = 50
