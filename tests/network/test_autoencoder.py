"""Truths of the network: the paper's formulas, written out with loops and numpy."""

import json
from itertools import pairwise

import numpy as np
import pytest
import torch

from deformer.errors import InputError
from deformer.geometry.mesh import one_rings
from deformer.network.autoencoder import GraphConv, MeanOverRing, MeshAutoencoder, ring_sum
from deformer.network.config import AdamSettings, FactorisationSettings, ModelConfig, resolve_config
from shapes import awkward, tube
from tolerances import tolerance

# A square of two triangles and a vertex without a face: rings of 2, 3, 3, 2 and 0 neighbours.
FACES = np.array([[0, 1, 2], [2, 1, 3]])
RINGS = {0: [1, 2], 1: [0, 2, 3], 2: [0, 1, 3], 3: [1, 2], 4: []}


def tiny_rings():
    return one_rings(FACES, 5)


def ring_mean_by_loop(x):
    """Mean over the neighbours of the tiny mesh; x (5, …)."""
    mean = np.zeros_like(x)
    for i, ring in RINGS.items():
        for j in ring:
            mean[i] += x[j] / len(ring)
    return mean


def randomised(network, seed=0):
    """The network with all parameters random, biases included, in float64."""
    generator = torch.Generator().manual_seed(seed)
    network = network.double()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(0.5 * torch.randn(parameter.shape, generator=generator))
    return network


def arrays(network):
    return {name: value.detach().numpy() for name, value in network.named_parameters()}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_ring_mean_by_loop(dtype):
    x = np.random.default_rng(0).normal(size=(5, 4, 3))
    found = MeanOverRing(*tiny_rings())(torch.tensor(x, dtype=dtype))
    assert found.dtype == dtype
    # The reciprocal degrees are kept in float32, at every dtype.
    np.testing.assert_allclose(found.numpy(), ring_mean_by_loop(x), **tolerance(np.float32))


def test_ring_mean_of_linear_positions_on_a_regular_mesh():
    """Neighbours of an inner vertex lie symmetrically: their mean is the vertex."""
    mesh = tube(8, 15)
    x = torch.tensor(mesh.vertices[:, :1])
    found = MeanOverRing(*one_rings(mesh.faces, len(x)))(x).numpy().ravel()
    inner = slice(8, -8)
    np.testing.assert_allclose(found[inner], mesh.vertices[inner, 0], atol=1e-6)


def test_ring_mean_has_the_gradient_of_its_differences():
    mean = MeanOverRing(*tiny_rings())
    x = torch.randn(5, 2, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    assert torch.autograd.gradcheck(mean, (x.requires_grad_(),))


def test_ring_mean_gradient_is_the_transposed_mean():
    """⟨mean(x), g⟩ = ⟨x, ∇⟩ for rings of different size, an empty one included."""
    mesh = awkward()
    mean = MeanOverRing(*one_rings(mesh.faces, len(mesh.vertices)))
    generator = torch.Generator().manual_seed(1)
    x, g = torch.randn(2, len(mesh.vertices), 6, dtype=torch.float64, generator=generator)
    x.requires_grad_()
    y = mean(x)
    y.backward(g)
    torch.testing.assert_close((x * x.grad).sum(), (y * g).sum(), **tolerance(np.float64))


def test_scattered_sum_equals_the_sparse_product():
    """The formula for devices without sparse products, on a stand-in tensor that says it is one."""

    class Elsewhere(torch.Tensor):
        @property
        def device(self):
            return torch.device("mps")

    indptr, rings = tiny_rings()
    crow, columns = torch.from_numpy(indptr), torch.from_numpy(rings)
    rows = torch.repeat_interleave(torch.arange(5), crow.diff())
    x = torch.randn(5, 3, generator=torch.Generator().manual_seed(2))
    sparse = ring_sum(x, crow, rows, columns)
    with torch._C.DisableTorchFunctionSubclass():
        scattered = ring_sum(x.as_subclass(Elsewhere), crow, rows, columns)
    torch.testing.assert_close(scattered.as_subclass(torch.Tensor), sparse)
    torch.testing.assert_close(sparse[4], torch.zeros(3))


def test_graph_convolution_by_loop():
    """y_i = W_point x_i + W_neighbour mean_j x_j + b, and back with transposed weights."""
    conv = randomised(GraphConv(9, 4))
    w = arrays(conv)
    x = np.random.default_rng(3).normal(size=(5, 9))
    mean = ring_mean_by_loop(x)
    forward = conv(torch.tensor(x), torch.tensor(mean)).detach().numpy()
    for i in range(5):
        expected = w["point"] @ x[i] + w["neighbour"] @ mean[i] + w["bias"]
        np.testing.assert_allclose(forward[i], expected, **tolerance(np.float64))
    y = np.random.default_rng(4).normal(size=(5, 4))
    mean = ring_mean_by_loop(y)
    back = conv.back(torch.tensor(y), torch.tensor(mean)).detach().numpy()
    for i in range(5):
        expected = w["point"].T @ y[i] + w["neighbour"].T @ mean[i] + w["bias_back"]
        np.testing.assert_allclose(back[i], expected, **tolerance(np.float64))


def encode_by_formula(w, x, layers):
    """Latent codes of x (V, N, 9): tanh after every layer but the last of several."""
    for depth in range(layers):
        conv = {name: w[f"convs.{depth}.{name}"] for name in ("point", "neighbour", "bias")}
        x = x @ conv["point"].T + ring_mean_by_loop(x) @ conv["neighbour"].T + conv["bias"]
        if layers == 1 or depth < layers - 1:
            x = np.tanh(x)
    return np.einsum("vnm,vmk->nk", x, w["C"])


def decode_by_formula(w, z, layers):
    """Features (V, N, 9) of codes: Cᵀ z, then transposed layers in reverse, tanh after each."""
    x = np.einsum("vmk,nk->vnm", w["C"], z)
    for depth in reversed(range(layers)):
        conv = {name: w[f"convs.{depth}.{name}"] for name in ("point", "neighbour", "bias_back")}
        x = x @ conv["point"] + ring_mean_by_loop(x) @ conv["neighbour"] + conv["bias_back"]
        x = np.tanh(x)
    return x


@pytest.mark.parametrize("layers", [(9,), (5,), (7, 4), (6, 5, 3)])
def test_network_by_formula(layers):
    network = randomised(MeshAutoencoder(*tiny_rings(), 3, layers))
    w = arrays(network)
    x = np.random.default_rng(5).uniform(-0.95, 0.95, (5, 4, 9))
    z = encode_by_formula(w, x, len(layers))
    with torch.no_grad():
        estimate, codes = network(torch.tensor(x))
    np.testing.assert_allclose(codes.numpy(), z, **tolerance(np.float32))
    expected = decode_by_formula(w, z, len(layers))
    np.testing.assert_allclose(estimate.numpy(), expected, **tolerance(np.float32))


@pytest.mark.parametrize("layers", [(9,), (40, 30)])
def test_a_new_network_has_normal_weights_of_one_deviation_and_no_biases(layers):
    """The start of the paper's authors, on a mesh of any size."""
    torch.manual_seed(0)
    drawn = []
    for size in (5, 50):
        for name, value in MeshAutoencoder(*one_rings(FACES, size), 20, layers).named_parameters():
            if "bias" in name:
                assert (value == 0).all()
            else:
                entries = value.detach().flatten()
                # Six standard errors of the deviation and of the mean of normal numbers.
                assert entries.std() == pytest.approx(0.02, rel=6 / (2 * len(entries)) ** 0.5)
                assert abs(entries.mean()) < 6 * 0.02 / len(entries) ** 0.5
                drawn.append(entries)
    scaled = torch.cat(drawn) / 0.02
    # Normal, not uniform or truncated: the fourth moment is 3.
    assert (scaled**4).mean() == pytest.approx(3, rel=6 * (96 / len(scaled)) ** 0.5 / 3)


def test_components_beyond_the_principal_ones_hardly_change_the_start():
    """Three shapes have three principal components; what else there is starts small."""
    mesh = tube(30, 20)
    x = 0.1 * torch.randn(len(mesh.vertices), 3, 9, generator=torch.Generator().manual_seed(0))
    errors = []
    for components in (3, 40):
        torch.manual_seed(1)
        network = MeshAutoencoder(*one_rings(mesh.faces, len(mesh.vertices)), components, (9,))
        network.start_from_components(x)
        with torch.no_grad():
            errors.append((network(x)[0] - x).square().sum() / x.square().sum())
    assert errors[1] < errors[0] + 0.01 and errors[0] < 0.1


@pytest.mark.parametrize("layers", [(9,), (7, 4)])
def test_weights_are_tied(layers):
    """There is one set of matrices: C, and two matrices and two biases a convolution."""
    network = MeshAutoencoder(*tiny_rings(), 3, layers)
    names = {name.split(".")[-1] for name, _ in network.named_parameters()}
    assert names == {"C", "point", "neighbour", "bias", "bias_back"}
    widths = [9, *layers]
    count = 5 * layers[-1] * 3
    for a, b in pairwise(widths):
        count += 2 * a * b + a + b
    assert sum(parameter.numel() for parameter in network.parameters()) == count


def test_a_given_ring_mean_changes_nothing():
    network = MeshAutoencoder(*tiny_rings(), 3, (7, 4))
    x = torch.randn(5, 2, 9)
    torch.testing.assert_close(network(x, network.mean(x)), network(x))


def test_network_gradients_are_those_of_its_differences():
    network = randomised(MeshAutoencoder(*tiny_rings(), 2, (4, 3)))
    names = [name for name, _ in network.named_parameters()]
    x = torch.randn(5, 2, 9, dtype=torch.float64, generator=torch.Generator().manual_seed(6))

    def outputs(*parameters):
        return torch.func.functional_call(network, dict(zip(names, parameters, strict=True)), (x,))

    values = tuple(p.detach().clone().requires_grad_() for p in network.parameters())
    assert torch.autograd.gradcheck(outputs, values)


def test_presets_are_the_papers_and_ours():
    paper = resolve_config("paper", components=7)
    adam = paper.training
    assert isinstance(adam, AdamSettings)
    assert paper.components == 7 and adam.mixed_shapes == 0 and paper.layers == (9,)
    constants = (adam.sparsity, adam.range_weight, adam.range_limit, paper.d_min, paper.d_max)
    assert constants == (0.5, 0.5, 5.0, 0.2, 0.4)
    assert adam.learning_rate == 1e-3
    # Not in the paper, but in the public code of its authors.
    assert (adam.initial, adam.epochs) == ("random", 2000)
    own = ModelConfig(name="own", training=AdamSettings(epochs=12))
    assert resolve_config(own, epochs=None) == own
    default = resolve_config("default", epochs=7, align=True)
    assert default == ModelConfig(training=FactorisationSettings(epochs=7), align=True)


@pytest.mark.parametrize(
    "config",
    [
        resolve_config("paper", components=7),
        resolve_config("default"),
        ModelConfig("deep", 3, AdamSettings(layers=(7, 5), encoder="network")),
        ModelConfig(training=FactorisationSettings(sparsity=1.5)),
    ],
)
def test_configurations_come_back_from_json(config):
    assert ModelConfig.from_dict(json.loads(json.dumps(config.as_dict()))) == config


@pytest.mark.parametrize(
    ("settings", "change"),
    [
        (ModelConfig, {"components": 0}),
        (ModelConfig, {"d_min": 0.4, "d_max": 0.4}),
        (ModelConfig, {"d_min": -0.1}),
        (AdamSettings, {"layers": ()}),
        (AdamSettings, {"layers": (9, 0)}),
        (AdamSettings, {"epochs": 0}),
        (AdamSettings, {"sparsity": -1.0}),
        (AdamSettings, {"range_weight": -1.0}),
        (AdamSettings, {"mixed_shapes": -1}),
        (AdamSettings, {"learning_rate": 0.0}),
        (AdamSettings, {"schedule": "linear"}),
        (AdamSettings, {"encoder": "projection", "layers": (9, 9)}),
        (FactorisationSettings, {"epochs": 0}),
        (FactorisationSettings, {"sparsity": -1.0}),
    ],
    ids=str,
)
def test_impossible_settings_are_refused(settings, change):
    with pytest.raises(InputError, match=next(iter(change))):
        settings(**change)


def test_unknown_preset_is_refused():
    with pytest.raises(InputError, match=r"paper.*'papers'"):
        resolve_config("papers")
