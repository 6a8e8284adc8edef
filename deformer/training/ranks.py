"""The processes of a `torchrun`, which train one network together.

The first process, rank 0, does everything that one process does: it reads and writes files, tells
progress, and decides when the training ends. The others, its assistants, take the same steps with
other shapes; DistributedDataParallel averages the gradients.
"""

from __future__ import annotations

import gc
import os
from datetime import timedelta
from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from deformer.errors import InputError
from deformer.linalg import resolve_device
from deformer.network import losses
from deformer.training.launch import launched

# Assistants wait for rank 0 to read its shapes and extract features.
_PATIENCE = timedelta(days=2)


class Ranks:
    """All processes of the training; on its own, a process does nothing of what others would.

    Attributes:
        rank: number of this process, from 0.
        count: number of processes.
    """

    def __init__(self) -> None:
        """Meet the others; each process must do so."""
        self.rank, self.count = launched()
        if self.count > 1:
            # Messages go by gloo; gradients by NCCL where they are on a GPU.
            backend = "cpu:gloo,cuda:nccl" if torch.cuda.is_available() else "gloo"
            distributed.init_process_group(backend, timeout=_PATIENCE)

    def meet(self) -> None:
        """Wait until all are here: a process that ends early may take the others' connections."""
        if self.count > 1:
            distributed.barrier()

    def leave(self) -> None:
        """End the connection to the others, once nothing uses it.

        What still has it at the end of the process may abort that: networks are in cycles.
        """
        if self.count > 1:
            gc.collect()
            distributed.destroy_process_group()

    def device(self, name: str) -> torch.device:
        """The device of a name; of several GPUs the one with this process's local rank."""
        device = resolve_device(name)
        if self.count > 1 and device == torch.device("cuda"):
            return torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
        return device

    def tell(self, message: Any = None) -> Any:
        """What rank 0 tells, arrays and dataclasses; each process calls it at the same time."""
        if self.count == 1:
            return message
        told = [message]
        distributed.broadcast_object_list(told, src=0, device=torch.device("cpu"))
        return told[0]

    def parallel(self, network: nn.Module) -> nn.Module:
        """The network, with gradients that are means over the processes."""
        if self.count == 1:
            return network
        return DistributedDataParallel(network, broadcast_buffers=False)

    def own(self, shapes: Tensor) -> Tensor:
        """This process's part (V, n, 9) of shapes (V, N, 9).

        Raises:
            InputError: there are fewer shapes than processes.
        """
        if self.count == 1:
            return shapes
        if shapes.shape[1] < self.count:
            raise InputError(
                f"train: got {shapes.shape[1]} shapes a step for {self.count} processes; start "
                "fewer"
            )
        return shapes[:, self.rank :: self.count].contiguous()

    def loss(
        self, own: losses.Loss, z: Tensor, total: int, weight: float, limit: float
    ) -> losses.Loss:
        """Terms whose means over the processes are those of all shapes, as are their gradients.

        Args:
            own: the terms of this process's shapes.
            z: (n, K) their codes.
            total: N, the number of all shapes.
            weight, limit: λ₂ and θ, as in `losses.loss`.
        """
        if self.count == 1:
            return own
        # V(Z) is of the largest codes: it belongs to the processes that have them.
        largest = z.abs().amax(dim=0)
        greatest = largest.detach().clone()
        distributed.all_reduce(greatest, distributed.ReduceOp.MAX)
        having = (largest.detach() == greatest).to(z.dtype)
        number = having.clone()
        distributed.all_reduce(number)
        share = self.count * having / number
        latent_range = (share * (largest - limit).clamp(min=0)).sum() / z.shape[1]
        return losses.Loss(
            own.reconstruction * (len(z) * self.count / total),
            own.sparsity,
            weight * latent_range,
        )

    def terms(self, loss: losses.Loss) -> tuple[float, ...]:
        """The terms of all shapes."""
        if self.count > 1:
            mean = torch.stack([term.detach() for term in loss])
            distributed.all_reduce(mean)
            return tuple((mean / self.count).tolist())
        return tuple(term.item() for term in loss)
