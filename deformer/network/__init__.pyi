from . import losses as losses
from .autoencoder import (
    MeshAutoencoder as MeshAutoencoder,
)
from .config import (
    FEATURES as FEATURES,
    MOST_EPOCHS as MOST_EPOCHS,
    PRESETS as PRESETS,
    AdamSettings as AdamSettings,
    FactorisationSettings as FactorisationSettings,
    ModelConfig as ModelConfig,
    resolve_config as resolve_config,
)
from .decoder import (
    Decoder as Decoder,
)
from .encoder import (
    Encoder as Encoder,
)
from .locality import (
    locality_row as locality_row,
)
from .weights import (
    ConvolutionWeights as ConvolutionWeights,
    NetworkWeights as NetworkWeights,
)
