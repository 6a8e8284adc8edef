from .bend_limits import (
    BendLimits as BendLimits,
    choose_samples as choose_samples,
    fit_bend_limits as fit_bend_limits,
)
from .latent_prior import (
    LatentPrior as LatentPrior,
    fit_prior as fit_prior,
)
from .model import (
    HANDLE_COUNTS as HANDLE_COUNTS,
    DeformationModel as DeformationModel,
)
from .rigid_prior import (
    DIFFUSE_PRIOR as DIFFUSE_PRIOR,
    RigidPrior as RigidPrior,
    diffuse_prior_cost as diffuse_prior_cost,
    fit_rigid_prior as fit_rigid_prior,
)
from .storage import (
    check_model_folder as check_model_folder,
    load_model as load_model,
    save_names as save_names,
    shipped_models as shipped_models,
)
