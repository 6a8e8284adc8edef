from .bend_limits import (
    BendLimits as BendLimits,
    choose_marks as choose_marks,
    fit_limits as fit_limits,
)
from .latent_prior import (
    LatentPrior as LatentPrior,
    fit_prior as fit_prior,
)
from .model import (
    DeformationModel as DeformationModel,
)
from .rigid_prior import (
    FREE as FREE,
    Placement as Placement,
    fit_placement as fit_placement,
    surprise as surprise,
)
from .storage import (
    load_model as load_model,
    save_names as save_names,
    shipped_models as shipped_models,
)
