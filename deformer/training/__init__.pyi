from . import trainer as trainer
from .checkpoints import (
    has_checkpoint as has_checkpoint,
)
from .cross_validation import (
    HandleFit as HandleFit,
    choose_noise as choose_noise,
    one_by_one as one_by_one,
)
from .loop import (
    TrainingProgress as TrainingProgress,
)
from .sparse_components import (
    LocalisedSettings as LocalisedSettings,
    localised_components as localised_components,
)
from .trainer import (
    train as train,
)
