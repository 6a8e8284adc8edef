"""Networks with random weights: what a decoder or encoder must reproduce without training."""

import torch

from deformer.geometry.mesh import site_rings
from deformer.network.autoencoder import MeshAutoencoder


def random_network(mesh, layers, components=4, size=1.0):
    """A network of a mesh with random components and biases, and the rings of the mesh's sites.

    Args:
        mesh: the mesh.
        layers: output widths of the graph convolutions.
        components: number of latent dimensions K.
        size: standard deviation of the entries of the component matrix C.
    """
    rings = site_rings(mesh)
    torch.manual_seed(0)
    network = MeshAutoencoder(*rings, components, layers)
    with torch.no_grad():
        # Biases of a new network are zero, and an error in their use would not show.
        for conv in network.layers:
            conv.bias_back.normal_()
        network.C.normal_(std=size)
        for conv in network.layers:
            conv.bias.normal_()
    return network, rings
