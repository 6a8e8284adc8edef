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
from .launch import assist_training as assist_training
from .loop import (
    TrainingProgress as TrainingProgress,
)
from .memory import (
    TrainingMemory as TrainingMemory,
    training_memory as training_memory,
)
from .sparse_components import (
    LocalisedSettings as LocalisedSettings,
    localised_components as localised_components,
)
from .trainer import (
    check_resumable as check_resumable,
    train as train,
)
