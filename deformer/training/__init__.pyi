from .checkpoints import (
    check_checkpoint as check_checkpoint,
    has_checkpoint as has_checkpoint,
    remove_checkpoint as remove_checkpoint,
)
from .cross_validation import (
    HandleFit as HandleFit,
    choose_noise as choose_noise,
    fit_each_noise as fit_each_noise,
)
from .loop import (
    TrainingProgress as TrainingProgress,
)
from .sparse_components import (
    LocalisedSettings as LocalisedSettings,
    localised_components as localised_components,
)
from .trainer import (
    check_resumable as check_resumable,
    train as train,
)
